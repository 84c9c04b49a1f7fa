"""What must hold for the repository as a whole: nothing of one machine in it, nothing undocumented, commands that agree."""

import ast
import hashlib
import os
import re
import shutil
import subprocess
import tomllib
from functools import cache
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

TOP = Path(__file__).resolve().parent.parent
DATA = Path(os.environ.get("COSIM_DATA", TOP.parent / "shared" / "data"))
LARGEST = 1024 * 1024
LARGE_ON_PURPOSE: set[str] = set()

# spelt in pieces, so that this file does not find itself
MACHINE_PATH = re.compile(r"(?<![\w.:/~-])/(?:" + "|".join(["work", "home", "root", "Users"]) + r")/[\w.]")
WINDOWS_PATH = re.compile(r"\b[A-Z]:\\(?:" + "Users|work" + r")\\")
REGISTRY = re.compile(
    "|".join([r"py" + r"pi\.org", "python" + "hosted", "--(?:extra-)?" + "index-url", "find-" + "links"])
)


@cache
def _tracked() -> list[Path]:
    if shutil.which("git") is None or not (TOP / ".git").exists():
        pytest.skip("not a git checkout, so there is no list of committed files")
    names = subprocess.run(
        ["git", "ls-files", "-z"], cwd=TOP, capture_output=True, check=True
    ).stdout.decode()
    return [TOP / name for name in names.split("\0") if name and (TOP / name).is_file()]


@cache
def _texts() -> dict[str, str]:
    texts = {}
    for path in _tracked():
        content = path.read_bytes()
        if b"\0" not in content:
            texts[path.relative_to(TOP).as_posix()] = content.decode("utf-8")
    return texts


@cache
def _tree(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"))


def _sources() -> list[Path]:
    return [
        path for path in _tracked() if path.suffix == ".py" and "tests" not in path.relative_to(TOP).parts
    ]


@pytest.mark.parametrize(
    ("pattern", "text"),
    [
        (MACHINE_PATH, "see /wo" + "rk/main/x"),
        (WINDOWS_PATH, "C:\\Us" + "ers\\me"),
        (REGISTRY, "https://py" + "pi.org/x"),
    ],
)
def test_the_patterns_find_what_they_are_for(pattern: re.Pattern[str], text: str) -> None:
    assert pattern.search(text)


@pytest.mark.parametrize(
    "pattern", [MACHINE_PATH, WINDOWS_PATH, REGISTRY], ids=["path", "windows path", "registry"]
)
def test_nothing_of_one_machine_is_committed(pattern: re.Pattern[str]) -> None:
    found = [
        f"{name}:{number}: {line.strip()[:100]}"
        for name, text in _texts().items()
        for number, line in enumerate(text.splitlines(), 1)
        if pattern.search(line)
    ]
    assert not found


def test_no_large_file_is_committed() -> None:
    large = {p.relative_to(TOP).as_posix() for p in _tracked() if p.stat().st_size > LARGEST}
    assert large <= LARGE_ON_PURPOSE, "name it in LARGE_ON_PURPOSE, or make it smaller"


@pytest.mark.data
def test_no_data_of_others_is_committed() -> None:
    if not DATA.is_dir():
        pytest.skip("the public measured data is not here (set COSIM_DATA)")
    foreign = [path for path in DATA.rglob("*") if path.is_file() and path.name != "README.md"]
    assert foreign
    digests = {hashlib.sha256(path.read_bytes()).hexdigest() for path in foreign}
    # rows too, so that an excerpt is found: long lines with numbers from each text file
    rows = {
        line.strip()
        for path in foreign
        if path.suffix == ".csv"
        for line in path.read_text(encoding="utf-8", errors="replace").splitlines()
        if len(line) > 40 and re.search(r"\d\.\d{3}", line)
    }
    for path in _tracked():
        content = path.read_bytes()
        assert hashlib.sha256(content).hexdigest() not in digests, f"{path} is a copy of foreign data"
        if b"\0" not in content:
            copied = rows & {line.strip() for line in content.decode("utf-8").splitlines()}
            assert not copied, f"{path} holds rows of foreign data"


def _undocumented(tree: ast.Module, name: str) -> list[str]:
    silent = [] if ast.get_docstring(tree) else [name]
    scopes: list[tuple[ast.Module | ast.ClassDef, str]] = [(tree, name)]
    for scope, label in scopes:
        for node in scope.body:
            if not isinstance(
                node, (ast.FunctionDef, ast.AsyncFunctionDef, ast.ClassDef)
            ) or node.name.startswith("_"):
                continue
            here = f"{label}:{node.name}"
            if not ast.get_docstring(node):
                silent.append(here)
            if isinstance(node, ast.ClassDef):
                scopes.append((node, here))
    return silent


def test_undocumented_names_are_found() -> None:
    tree = ast.parse(
        '"""Doc."""\nclass A:\n    """Doc."""\n    def f(self): ...\n    def _g(self): ...\ndef h(): ...\n'
    )
    assert _undocumented(tree, "m") == ["m:h", "m:A:f"]


def test_every_public_name_has_a_docstring() -> None:
    silent = []
    for path in _sources():
        silent += _undocumented(_tree(path), path.relative_to(TOP).as_posix())
    assert not silent


def _readme_commands(language: str) -> list[str]:
    text = (TOP / "README.md").read_text(encoding="utf-8")
    return [command.strip() for command in re.findall(rf"```{language}\n(.*?)```", text, re.DOTALL)]


def test_readme_has_two_commands_for_each_system() -> None:
    for language in ("bash", "powershell"):
        commands = _readme_commands(language)
        assert len(commands) == 2
        assert all("\n" not in command for command in commands)
        assert commands[0].endswith("cosim demo")
        assert commands[1].endswith("check.py")


def test_the_readme_is_short() -> None:
    assert len((TOP / "README.md").read_text(encoding="utf-8").split()) <= 600, "the rest belongs into docs/"


def test_ci_runs_the_readme_command_last() -> None:
    script = (TOP / ".ci" / "run").read_text(encoding="utf-8").strip().splitlines()
    assert script[-1] == _readme_commands("bash")[1]
    assert os.name == "nt" or os.access(TOP / ".ci" / "run", os.X_OK)


def test_readme_names_every_extra_and_installs_only_known_ones() -> None:
    project = tomllib.loads((TOP / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    known = set(project["optional-dependencies"])
    readme = (TOP / "README.md").read_text(encoding="utf-8")
    assert {extra for extra in known if f"`{extra}`" in readme} == known
    for command in _readme_commands("bash") + _readme_commands("powershell"):
        for asked in re.findall(r"\.\[([\w,]+)\]", command):
            assert set(asked.split(",")) <= known


def test_links_between_documents_lead_somewhere() -> None:
    link = re.compile(r"\]\(([^)#\s]+)(?:#[^)]*)?\)")
    broken = [
        f"{path.relative_to(TOP).as_posix()} -> {target}"
        for path in _tracked()
        if path.suffix == ".md"
        for target in link.findall(path.read_text(encoding="utf-8"))
        if "://" not in target and not (path.parent / target).exists()
    ]
    assert not broken


def test_index_lists_every_document() -> None:
    index = (TOP / "docs" / "index.md").read_text(encoding="utf-8")
    documents = {p.name for p in _tracked() if p.parent == TOP / "docs" and p.suffix == ".md"} - {"index.md"}
    assert {name for name in documents if f"]({name})" not in index} == set(), "add them to docs/index.md"


def test_changelog_has_the_version_or_unreleased() -> None:
    project = tomllib.loads((TOP / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    headings = re.findall(
        r"^## \[?([^\]\s]+)", (TOP / "CHANGELOG.md").read_text(encoding="utf-8"), re.MULTILINE
    )
    assert headings
    assert headings[0] in ("Unreleased", project["version"])


def test_tests_have_unique_names() -> None:
    names = [p.name for p in _tracked() if p.name.startswith("test_") and p.suffix == ".py"]
    assert sorted(names) == sorted(set(names)), "pytest imports test files by base name"


# clients of the core: what they need of each other lies below them
CLIENTS = {
    f"cosim.{room}"
    for room in ("compare", "calibrate", "identify", "machines", "master", "ssp", "logs", "inference")
}


def _room(module: str) -> str | None:
    """The package to which a module belongs: a folder or a file at the top of cosim, or fmus."""
    first, _, rest = module.partition(".")
    return (
        first if first == "fmus" else f"cosim.{rest.partition('.')[0]}" if first == "cosim" and rest else None
    )


@cache
def _imports() -> set[tuple[str, str, str]]:
    """(file, its room, room that it imports), wherever in the file the import stands."""
    found = set()
    for path in _sources():
        parts = path.relative_to(TOP).with_suffix("").parts
        own = _room(".".join(parts)) if parts[0] in ("cosim", "fmus") else None
        for node in ast.walk(_tree(path)):
            names = [a.name for a in node.names] if isinstance(node, ast.Import) else []
            if isinstance(node, ast.ImportFrom) and node.module:
                names = [f"{node.module}.{a.name}" for a in node.names]
            for other in map(_room, names):
                if own and other and other != own:
                    found.add(("/".join(parts), own, other))
    return found


def test_no_two_packages_import_each_other() -> None:
    edges = {(own, other) for _, own, other in _imports()}
    both = {tuple(sorted(edge)) for edge in edges if edge[::-1] in edges}
    assert not both


def test_the_diagnosis_is_a_client_and_nobody_below_it_knows_it() -> None:
    wrong = {
        (file, other) for file, own, other in _imports() if own in CLIENTS and other == "cosim.diagnosis"
    }
    assert not wrong


def test_the_rooms_of_the_diagnosis_import_in_one_direction() -> None:
    top = TOP / "cosim" / "diagnosis"
    needs: dict[str, set[str]] = {}
    for path in _sources():
        if top not in path.parents:
            continue
        own = path.relative_to(top).parts[0].removesuffix(".py")
        for node in ast.walk(_tree(path)):
            if not isinstance(node, ast.ImportFrom) or not node.module:
                continue
            _, inside, rest = f"{node.module}.".partition("cosim.diagnosis.")
            if inside:
                named = {rest.partition(".")[0]} if rest else {a.name for a in node.names}
                needs.setdefault(own, set()).update(named - {own})
    assert {"model", "record", "fitting", "residuals", "hypotheses", "held_out", "verdict"} <= set(needs)
    order = list(TopologicalSorter(needs).static_order())  # raises CycleError, which names the circle
    assert order.index("record") < order.index("verdict") < order.index("pipeline")


# the field's words, so that a paper and the code can be read side by side
HOME_MADE = {
    "alike": "indistinguishable",
    "doubt": "discrepancy",
    "doubts": "discrepancies",
    "carried": "propagated",
    "valley": "local minimum",
    "valleys": "local minima",
    "memory": "hysteresis",
    "swing": "slow oscillation",
    "mark": "signature",
    "marks": "signatures",
    "told": "reported",
    "bent": "strained, or a free-form law",
    "story": "pipeline",
    "stranger": "out of the library",
}


def _names(tree: ast.Module) -> list[str]:
    """Names of functions and classes, and the fields of classes."""
    found = []
    for node in ast.walk(tree):
        if isinstance(node, (ast.FunctionDef, ast.ClassDef)):
            found.append(node.name)
        if isinstance(node, ast.ClassDef):
            fields = [n.target for n in node.body if isinstance(n, ast.AnnAssign)]
            found += [f.id for f in fields if isinstance(f, ast.Name)]
    return found


def test_the_names_of_a_module_are_found() -> None:
    tree = ast.parse("class A:\n    b: int\n    def c(self): ...\ndef d(): ...\n")
    assert sorted(_names(tree)) == ["A", "b", "c", "d"]


def test_the_diagnosis_and_its_core_use_the_words_of_the_field() -> None:
    found = []
    for path in _sources():
        if path.relative_to(TOP).parts[:2] not in (("cosim", "diagnosis"), ("cosim", "inference")):
            continue
        for name in (path.stem, *_names(_tree(path))):
            words = set(re.findall(r"[a-z]+", re.sub(r"(?<=[a-z])(?=[A-Z])", "_", name).lower()))
            found += [f"{path.stem}: {name}: {HOME_MADE[word]}" for word in words & set(HOME_MADE)]
    assert not found


def test_the_inference_core_stands_alone() -> None:
    assert {other for _, own, other in _imports() if own == "cosim.inference"} <= {"cosim.errors"}


def _taken(tree: ast.Module) -> list[tuple[str, str]]:
    """(module, name) of each name that a file takes from the product or from another benchmark."""
    return [
        (node.module, alias.name)
        for node in ast.walk(tree)
        if isinstance(node, ast.ImportFrom)
        and node.module
        and node.level == 0
        and node.module.partition(".")[0] in ("cosim", "fmus", "benchmarks")
        for alias in node.names
    ]


def _given(module: str) -> set[str]:
    """Names that a module binds at its top, or that are its submodules; empty where there is no such module."""
    path = TOP.joinpath(*module.split("."))
    package = path / "__init__.py"
    file = package if package.is_file() else path.with_suffix(".py")
    if not file.is_file():
        return {p.stem for p in path.glob("*.py")} if path.is_dir() else set()
    found = {p.stem for p in path.iterdir()} if path.is_dir() else set()
    for node in ast.walk(_tree(file)):
        if isinstance(node, ast.ImportFrom | ast.Import):
            found |= {(a.asname or a.name).partition(".")[0] for a in node.names}
        elif isinstance(node, ast.FunctionDef | ast.ClassDef):
            found.add(node.name)
        elif isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            found.add(node.id)
    if "__getattr__" in found:  # names that are found when they are asked for
        found |= {
            n.value for n in ast.walk(_tree(file)) if isinstance(n, ast.Constant) and isinstance(n.value, str)
        }
    return found


def test_what_benchmarks_and_pages_import_is_there() -> None:
    """They are not run with the tests: a function that moved was found by nobody."""
    files = [p for folder in ("benchmarks", "docs", "examples") for p in (TOP / folder).rglob("*.py")]
    missing = [
        f"{file.relative_to(TOP)}: {module}.{name}"
        for file in files
        for module, name in _taken(_tree(file))
        if name not in _given(module)
    ]
    assert len(files) > 40
    assert missing == []


def _constants(tree: ast.Module) -> dict[str, str]:
    """Constants of a module: name in capitals -> its value as written."""
    found = {}
    for node in tree.body:
        target = (
            node.targets[0]
            if isinstance(node, ast.Assign)
            else node.target
            if isinstance(node, ast.AnnAssign)
            else None
        )
        if isinstance(target, ast.Name) and target.id.isupper() and node.value is not None:  # type: ignore[union-attr]
            found[target.id] = ast.unparse(node.value)  # type: ignore[union-attr]
    return found


def test_no_constant_has_two_values_in_one_package() -> None:
    """A reader takes a name that he has seen next door for the same thing."""
    values: dict[tuple[Path, str], dict[str, str]] = {}
    for file in (p for p in _sources() if p.is_relative_to(TOP / "cosim")):
        for name, value in _constants(_tree(file)).items():
            values.setdefault((file.parent.relative_to(TOP), name), {})[file.name] = value
    twice = {
        f"{folder}: {name}": each for (folder, name), each in values.items() if len(set(each.values())) > 1
    }
    assert twice == {}
