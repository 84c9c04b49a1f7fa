"""Do the tests notice changes: ``python benchmarks/mutation.py [--count 60] [--seed 1] [--only NAME] [--json FILE]``.

Draws changes of the core and of the equations of the blocks (a comparison turned, a sum made a difference, a number
doubled, a condition negated), makes each in a copy of the project and runs the own fast tests of that module, no others.
Prints the changes that no test noticed and the share that was, with its 95 % interval (Wilson). A run that takes ten
times as long as without a change counts as noticed. Own code: the tools at hand run whole suites over all mutants of a
package, where here a sample is drawn and each module is paired with its own tests.
"""

import argparse
import ast
import copy
import json
import os
import random
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path

from scipy.stats import binomtest

TOP = Path(__file__).resolve().parent.parent
NEEDED = ("cosim", "fmus", "tests", "benchmarks", "examples", "docs", "pyproject.toml")
INFERENCE, SYSTEM, FMUS = "tests/inference/test_", "tests/system/test_", "tests/fmus/test_"
# each module and its own fast tests
TESTS = {
    "cosim/inference/beginning.py": (f"{INFERENCE}beginning.py",),
    "cosim/inference/freeform.py": (f"{INFERENCE}freeform.py", f"{INFERENCE}problem.py"),
    "cosim/inference/held_out.py": (f"{INFERENCE}held_out_gain.py", f"{INFERENCE}parts_anew.py"),
    "cosim/inference/hypotheses.py": (f"{INFERENCE}hypotheses.py",),
    "cosim/inference/linear.py": (f"{INFERENCE}linear_reference.py",),
    "cosim/inference/noise.py": (f"{INFERENCE}noise_model.py",),
    "cosim/inference/pieces.py": (f"{INFERENCE}pieces.py",),
    "cosim/inference/problem.py": (f"{INFERENCE}problem.py",),
    "cosim/inference/sight.py": (f"{INFERENCE}sight.py",),
    "cosim/inference/spectrum.py": (f"{INFERENCE}noise_model.py",),
    "cosim/inference/unknowns.py": (f"{INFERENCE}problem.py",),
    "cosim/system/effects.py": (f"{SYSTEM}port_effects.py",),
    "cosim/system/graph.py": (f"{SYSTEM}graph.py",),
    "cosim/system/structure.py": (f"{SYSTEM}graph.py",),
    "cosim/system/superposition.py": (f"{SYSTEM}superposition.py",),
    "fmus/continuity.py": (f"{FMUS}continuity.py",),
    "fmus/dcv.py": (f"{FMUS}dcv.py",),
    "fmus/dead_zone.py": (f"{FMUS}dead_zone.py",),
    "fmus/mechanical.py": tuple(
        f"{FMUS}{name}.py" for name in ("mechanical", "friction", "friction_forms", "travel_ends")
    ),
    "fmus/ring.py": (f"{FMUS}ring.py",),
    "fmus/sensor.py": (f"{FMUS}sensor.py",),
}
TURNED: dict[type[ast.cmpop], type[ast.cmpop]] = {
    ast.Lt: ast.GtE, ast.LtE: ast.Gt, ast.Gt: ast.LtE, ast.GtE: ast.Lt, ast.Eq: ast.NotEq, ast.NotEq: ast.Eq,
    ast.Is: ast.IsNot, ast.IsNot: ast.Is, ast.In: ast.NotIn, ast.NotIn: ast.In,
}  # fmt: skip
EXCHANGED: dict[type[ast.operator], type[ast.operator]] = {
    ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult, ast.Pow: ast.Mult,
}  # fmt: skip
NAMES = {"min": "max", "max": "min", "minimum": "maximum", "maximum": "minimum", "all": "any", "any": "all"}


@dataclass(frozen=True)
class Change:
    """A change of one expression: where it is, in bytes of the file, and what stands there before and after."""

    module: str
    line: int
    start: int
    end: int
    before: str
    after: str


def changed(node: ast.AST) -> Iterator[ast.expr]:
    """The changes of this expression itself, not of what is inside it."""
    new = copy.deepcopy(node)
    match new:
        case ast.Compare(ops=[op]) if type(op) in TURNED:
            new.ops = [TURNED[type(op)]()]
            yield new
        case ast.BinOp(op=op) if type(op) in EXCHANGED:
            new.op = EXCHANGED[type(op)]()
            yield new
        case ast.BoolOp(op=op):
            new.op = ast.Or() if isinstance(op, ast.And) else ast.And()
            yield new
        case ast.UnaryOp(op=ast.Not() | ast.USub(), operand=operand):
            yield operand
        case ast.Constant(value=bool(value)):
            yield ast.Constant(not value)
        case ast.Constant(value=int() | float() as value):
            yield ast.Constant(value + 1 if isinstance(value, int) else 2.0 * value or 1.0)
        case ast.IfExp(test=test):
            new.test = ast.UnaryOp(ast.Not(), test)
            yield new
        case ast.Attribute(attr=name) | ast.Name(id=name) if name in NAMES:
            setattr(new, "attr" if isinstance(new, ast.Attribute) else "id", NAMES[name])
            yield new


def expressions(node: ast.AST) -> Iterator[ast.AST]:
    """All that is computed: no annotation, no decorator, no text of an error, not what a value looks like when printed."""
    if isinstance(node, ast.Raise | ast.Import | ast.ImportFrom | ast.JoinedStr | ast.arguments):
        return
    if isinstance(node, ast.keyword) and node.arg == "repr":
        return
    yield node
    for name, field in ast.iter_fields(node):
        if name in ("annotation", "returns", "decorator_list"):
            continue
        for child in field if isinstance(field, list) else [field]:
            if isinstance(child, ast.AST):
                yield from expressions(child)


def changes(module: str) -> list[Change]:
    """All changes of a module."""
    text = (TOP / module).read_bytes()
    begins = [0]
    for line in text.splitlines(keepends=True):
        begins.append(begins[-1] + len(line))
    found = []
    for node in expressions(ast.parse(text)):
        for new in changed(node):
            assert isinstance(node, ast.expr)
            assert node.end_lineno is not None
            assert node.end_col_offset is not None
            start = begins[node.lineno - 1] + node.col_offset
            end = begins[node.end_lineno - 1] + node.end_col_offset
            after = f"({ast.unparse(ast.fix_missing_locations(new))})"
            found.append(Change(module, node.lineno, start, end, text[start:end].decode(), after))
    return found


def passes(folder: Path, module: str, limit: float) -> bool:
    """Whether the module's own tests pass in the copy within `limit` s."""
    words = ["-m", "pytest", "-x", "-q", "-p", "no:cacheprovider", "-p", "no:xdist", *TESTS[module]]
    own = {"PYTHONPATH": str(folder), "COSIM_CACHE": str(folder / "cache"), "OPENBLAS_NUM_THREADS": "1"}
    try:
        done = subprocess.run(
            [sys.executable, *words], cwd=folder, env=os.environ | own, capture_output=True, timeout=limit
        )
    except subprocess.TimeoutExpired:
        return False
    return done.returncode == 0


def survives(folder: Path, change: Change, limit: float) -> bool:
    """Whether the module's tests pass with the change; the copy is as before afterwards."""
    file = folder / change.module
    text = file.read_bytes()
    file.write_bytes(text[: change.start] + change.after.encode() + text[change.end :])
    try:
        return passes(folder, change.module, limit)
    finally:
        file.write_bytes(text)


def main() -> None:
    """Draws, runs and prints."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--count", type=int, default=60, help="changes to draw")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", default="", help="modules whose path holds this")
    parser.add_argument("--json", type=Path, help="file for all that was drawn, and whether it was noticed")
    options = parser.parse_args()
    listed = [change for module in TESTS if options.only in module for change in changes(module)]
    if not listed:
        parser.error(f"--only {options.only}: no module has it in its path; there are {', '.join(TESTS)}")
    drawn = random.Random(options.seed).sample(listed, min(options.count, len(listed)))
    rows: list[dict[str, object]] = []
    limits: dict[str, float] = {}
    with tempfile.TemporaryDirectory(prefix="mutation_") as name:
        folder = Path(name)
        for part in NEEDED:
            source = TOP / part
            if source.is_dir():
                shutil.copytree(source, folder / part, ignore=shutil.ignore_patterns("__pycache__"))
            else:
                shutil.copy(source, folder / part)
        for change in sorted(drawn, key=lambda c: (c.module, c.start)):
            if change.module not in limits:
                begun = time.monotonic()
                if not passes(folder, change.module, 3600.0):
                    sys.exit(f"the tests of {change.module} fail without a change")
                limits[change.module] = 60.0 + 10.0 * (time.monotonic() - begun)
            survived = survives(folder, change, limits[change.module])
            rows.append(asdict(change) | {"noticed": not survived})
            if survived:
                print(f"{change.module}:{change.line}: {change.before} -> {change.after}", flush=True)
    noticed = sum(bool(row["noticed"]) for row in rows)
    low, high = binomtest(noticed, len(rows)).proportion_ci(method="wilson")
    print(
        f"{noticed} of {len(rows)} changes noticed: {noticed / len(rows):.0%} ({low:.0%} to {high:.0%}); "
        f"{len(listed)} possible, seed {options.seed}"
    )
    if options.json:
        options.json.write_text(json.dumps(rows, indent=1) + "\n")


if __name__ == "__main__":
    main()
