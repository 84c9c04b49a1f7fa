"""Build FMUs with pythonfmu: script, description, documentation, and an archive that is the same byte for byte each time."""

import hashlib
import subprocess
import sys
import zipfile
from collections.abc import Mapping
from pathlib import Path

from lxml import etree

from cosim import trust
from cosim.errors import ModelError, UsageError
from cosim.files import Scratch, whole
from fmus import registry
from fmus.compose import Composed, compose
from fmus.contract import Buffer
from fmus.describe import documentation, model_description, table
from fmus.specialise import flat_text

ARCHIVE_DATE = (2026, 1, 1, 0, 0, 0)
PICTURES = Path(__file__).parent / "pictures"
EQUATIONS = "Input, Parameters, State, Memory, start, begin, coefficients, output, advance"
PARTS = ("slave_base.py", "slave.py")  # of the slave, in the order in which one needs the other


def slave_text() -> str:
    """The slave's modules as one text, without their titles and without imports from this package."""
    texts = [
        (Path(__file__).parent / part).read_text(encoding="utf-8").partition('"""\n\n')[2] for part in PARTS
    ]
    lines = [line for line in "\n\n".join(texts).splitlines() if not line.startswith("from fmus.")]
    return "\n".join(lines)


def script(composed: Composed, starts: Mapping[str, float]) -> str:
    """Text of the FMU's script: the composed equations, the slave, and a class with the tables of this block."""
    rows = table(composed)
    buffers = [(b.length, b.resource) for b in composed.memory.values() if isinstance(b, Buffer)]
    names = list(composed.parameters)
    keys = {e.key: composed.parameters[e.key].start for e in composed.effects}
    tables = {
        "names": tuple(n for n, _, _ in rows),
        "starts": tuple(starts.get(n, v.start) for n, _, v in rows),
        "lows": tuple(v.low for _, _, v in rows),
        "highs": tuple(v.high for _, _, v in rows),
        "integers": tuple(i for i, (_, _, v) in enumerate(rows) if v.kind == "integer"),
        "n_inputs": len(composed.inputs),
        "n_outputs": len(composed.outputs),
        "takes_time": composed.takes_time,
        "direct": tuple(i for i, n in enumerate(composed.outputs) if n in composed.direct),
        "buffers": tuple(buffers),
        "switches": tuple((names.index(key), off) for key, off in keys.items()),
    }
    lines = [f"class {composed.block.name}(BlockSlave):", f'    """{composed.block.title}."""', ""]
    # pythonfmu looks these up by a new string at each call, which no cache knows: found here, the search ends at once
    lines.append('    __slots__ = ("do_step", "get_real", "set_real")')
    lines.append(f"    equations = ({EQUATIONS})")
    lines += [f"    {name} = {value!r}" for name, value in tables.items()]
    lines.append(f"    plain = {quoted(flat_text(compose(composed.block)))}")
    lines.append(f"    with_effects = {quoted(flat_text(composed)) if composed.effects else 'plain'}")
    # pythonfmu wants the class to have a method of its own, or the second instance crashes
    lines += ["", "    def __init__(self, **kwargs):", "        super().__init__(**kwargs)"]
    # pythonfmu runs this text again for each instance and never lets go of a class that it then finds: it finds the first
    lines += ["", "", "if locals() is not globals():", "    locals().clear()"]
    lines.append(f'    {composed.block.name} = globals()["{composed.block.name}"]')
    return f"{composed.source}\n\n{slave_text()}\n\n" + "\n".join(lines) + "\n"


def quoted(text: str) -> str:
    """A text as a readable literal of several lines."""
    assert "\\" not in text
    assert "'''" not in text
    return f"'''{text}'''"


def checked_starts(composed: Composed, starts: Mapping[str, float]) -> dict[str, float]:
    """Start values by name, each known and within its bounds.

    Raises:
        UsageError: an unknown name, or a value out of range.
    """
    known = composed.inputs | composed.parameters
    for name, value in starts.items():
        if name not in known:
            raise UsageError(
                f"{composed.block.name} has no '{name}'; {registry.suggestion(name, list(known))}"
            )
        low, high, unit = known[name].low, known[name].high, known[name].unit
        if not low <= value <= high:
            raise UsageError(
                f"{composed.block.name}.{name} = {value!r} {unit} is not within {low:g} to {high:g} {unit}"
            )
        if known[name].kind == "integer" and value != int(value):
            raise UsageError(f"{composed.block.name}.{name} = {value!r} is not a whole number")
    return {name: float(value) for name, value in starts.items()}


def build_fmu(
    composed: Composed,
    destination: Path,
    starts: Mapping[str, float] | None = None,
    resources: Mapping[str, bytes] | None = None,
) -> Path:
    """Build one FMU.

    Args:
        composed: the block with its effects.
        destination: the .fmu file to write.
        starts: start values that differ from the declarations, SI.
        resources: files to put among the FMU's resources, by name.

    Returns:
        `destination`.

    Raises:
        UsageError: a start value is unknown or out of range.
        ModelError: pythonfmu could not build it; the message holds its words.
    """
    values = checked_starts(composed, starts or {})
    text = script(composed, values)
    files = dict(resources or {})
    content = text.encode() + b"".join(name.encode() + data for name, data in sorted(files.items()))
    # modules are shared by name within a process: a name made of the content cannot meet another's code
    stem = f"{composed.block.name}_{hashlib.sha256(text.encode()).hexdigest()[:12]}"
    with Scratch("fmu_") as scratch:
        source = Path(scratch, "source")
        documents = Path(scratch, "documentation")
        source.mkdir()
        documents.mkdir()
        (source / f"{stem}.py").write_text(text, encoding="utf-8", newline="\n")
        description = model_description(composed, values, content)
        files["model_description.xml"] = etree.tostring(description, encoding="UTF-8", xml_declaration=True)
        for name, data in files.items():
            (source / name).write_bytes(data)
        (documents / "index.html").write_bytes(documentation(composed, values))
        built = run_pythonfmu(
            source / f"{stem}.py", Path(scratch, "built"), documents, [source / n for n in files]
        )
        destination.parent.mkdir(parents=True, exist_ok=True)
        repack(built, destination, PICTURES / f"{composed.block.name}.png")
    trust.remember(destination)
    return destination


def run_pythonfmu(file: Path, destination: Path, documents: Path, resources: list[Path]) -> Path:
    """Run pythonfmu's builder in a process of its own, because it imports the script."""
    command = [
        sys.executable,
        "-m",
        "pythonfmu",
        "build",
        "-f",
        str(file),
        "-d",
        str(destination),
        "--doc",
        str(documents),
    ]
    command += ["--no-external-tool", "--handle-state", "--serialize-state", *map(str, resources)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    built = list(destination.glob("*.fmu"))
    if done.returncode != 0 or len(built) != 1:
        *_, why = (done.stderr or done.stdout).strip().splitlines() or ["no FMU came of it"]
        raise ModelError(f"pythonfmu could not build {file.stem}: {why}")
    return built[0]


def repack(archive: Path, destination: Path, picture: Path) -> None:
    """Write the archive again: sorted, compressed, fixed dates and rights, without what only the builder needed."""
    with zipfile.ZipFile(archive) as old:
        entries = {
            name: old.read(name) for name in old.namelist() if name != "resources/model_description.xml"
        }
    if picture.exists():
        entries["model.png"] = picture.read_bytes()
    with whole(destination) as part, zipfile.ZipFile(part, "w") as new:
        for name in sorted(entries):
            info = zipfile.ZipInfo(name, ARCHIVE_DATE)
            info.compress_type = zipfile.ZIP_DEFLATED
            info.external_attr = 0o644 << 16
            info.create_system = 3  # the same on every platform
            new.writestr(info, entries[name], compresslevel=6)


def composed_block(name: str, component: str | None = None) -> Composed:
    """Block `name` with every effect of the library that acts on it, switched off by its start values."""
    return compose(registry.block(name), registry.effects_on(component or name, name))


def build_blocks(destination: Path, stimulus: bytes) -> list[Path]:
    """Build every block's FMU into a folder; `stimulus` is the CSV that the stimulus plays."""
    built = []
    for name in registry.BLOCKS:
        resources = {"stimulus.csv": stimulus} if name == "stimulus" else None
        built.append(build_fmu(composed_block(name), destination / f"{name}.fmu", resources=resources))
    return built
