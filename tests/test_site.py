"""The documents as a site: it builds, every link leads somewhere, and one that does not is noticed."""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

TOP = Path(__file__).resolve().parents[1]
SLOW = pytest.mark.slow


def build(top: Path, target: Path) -> subprocess.CompletedProcess[str]:
    for name in ("mkdocs", "material", "mkdocstrings"):
        pytest.importorskip(name, reason="pip install -e '.[docs]'")
    variables = os.environ | {
        "PYTHONPATH": os.pathsep.join([str(TOP), *sys.path]),
        "NO_MKDOCS_2_WARNING": "1",
    }
    words = [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", str(target)]
    return subprocess.run(words, cwd=top, env=variables, capture_output=True, text=True, timeout=300)


@pytest.fixture
def copy(tmp_path):
    """What the site is made from, to be damaged."""
    top = tmp_path / "top"
    shutil.copytree(TOP / "docs", top / "docs")
    shutil.copytree(TOP / "examples", top / "examples")
    for name in ("mkdocs.yml", "README.md", "CHANGELOG.md", "SECURITY.md"):
        shutil.copy(TOP / name, top)
    (top / "cosim").symlink_to(TOP / "cosim", target_is_directory=True)
    return top


def test_every_document_is_in_the_menu():
    """Without mkdocs, which the fast suite does not have."""
    menu = (TOP / "mkdocs.yml").read_text(encoding="utf-8").partition("\nnav:")[2]
    missing = [
        p.name for p in (TOP / "docs").glob("*.md") if not re.search(rf"[ \[]{re.escape(p.name)}\b", menu)
    ]
    assert missing == []


def test_no_document_says_a_section_twice():
    """A merge can leave the older copy of a section in place, whose figures then stand beside the new ones."""
    twice = []
    for path in [*(TOP / "docs").rglob("*.md"), TOP / "README.md"]:
        text = re.sub(r"^```.*?^```", "", path.read_text(encoding="utf-8"), flags=re.MULTILINE | re.DOTALL)
        above: list[str] = []
        seen = set()
        for marks, title in re.findall(r"^(#+) (.+)$", text, re.MULTILINE):
            above = [*above[: len(marks) - 1], title]
            if tuple(above) in seen:
                twice.append(f"{path.name}: {title}")
            seen.add(tuple(above))
    assert twice == []


@SLOW
def test_the_site_builds_and_holds_every_document_command_and_function(tmp_path):
    done = build(TOP, tmp_path / "site")
    assert done.returncode == 0, done.stderr
    pages = {path.stem for path in (TOP / "docs").glob("*.md")}
    assert pages <= {path.stem for path in (tmp_path / "site").glob("*.html")}
    commands = (tmp_path / "site" / "reference" / "cli.html").read_text(encoding="utf-8")
    for path in (TOP / "cosim" / "commands").glob("[a-z]*.py"):
        assert f"cosim {path.stem}" in commands or path.stem in ("export", "rig"), path.stem
    functions = (tmp_path / "site" / "reference" / "api.html").read_text(encoding="utf-8")
    for name in ("read_log", "diagnose", "DiagnosisResult.causes"):
        assert name in functions


@SLOW
@pytest.mark.parametrize(
    "link", ["[x](nowhere.md)", "[x](compare.md#nowhere)", "[x](../examples/nowhere.toml)"]
)
def test_a_link_that_leads_nowhere_fails_the_build(copy, tmp_path, link):
    page = copy / "docs" / "index.md"
    page.write_text(page.read_text(encoding="utf-8") + f"\n{link}\n", encoding="utf-8")
    done = build(copy, tmp_path / "site")
    assert done.returncode == 1
    assert "nowhere" in done.stderr
