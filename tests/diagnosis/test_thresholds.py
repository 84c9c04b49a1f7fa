"""Every number by which the diagnosis decides stands once, in one table, and the page prints that table."""

import ast
import importlib.util
from collections import defaultdict
from collections.abc import Collection, Iterator
from functools import cache
from pathlib import Path

import pytest

from cosim.diagnosis import thresholds as of_diagnosis
from cosim.inference import thresholds as of_inference
from cosim.inference.thresholds import listed

TOP = Path(__file__).resolve().parents[2]
TABLES = {"diagnosis": of_diagnosis, "inference": of_inference}

# how finely something is computed, or where a search begins: none of them decides what is said
NUMERICAL = {
    "diagnosis": """
        ABSURD AT_ONCE BANDWIDTH BEND BETTER_KNOWN CANDIDATES COARSEST COARSE_OFFSETS COMMANDS CORRELATION_TIMES
        CROSSED DOSE EVEN_STAMPS FACTOR_KNOTS FAR_OFF FINEST FINE_OFFSETS FIRST_ROUNDS FITTED_ON FREE_RUN_ROUNDS
        FULL GENERATIONS HALVINGS HARDLY_LATE HELD_FOR HELD_STEPS KNOTS LEAST_DIRECTION
        LEAST_OPENING LONGEST_STEP MEMBERS MET MOVED_BY NARROWEST NEWTON_ROUNDS NO_AMPLITUDE NO_NOISE ORDER_PARTS
        PADDED PART_REACH PATHS PERIODS PIECE PIECES PLAY POINTS POINTS_A_CYCLE POINTS_OF_LONG PREDICTED QUICK_KINDS
        QUICK_ROUNDS RATE_PARTS REFINED REPEATS RIDGES ROUGHLY SEAM_ANGLE SECTIONS SEED SEEN SEGMENT SHARE_KEPT
        SIZES_SETTLED SIZE_ROUNDS SLOPE_STEP SMALLEST_SHARE SMALLEST_START SPANS_OF_LOG START_STEP STEADY_TO
        STEPS_AT_FIRST STEPS_AT_MOST TAPERS TORQUE_CUTOFF WALK_ROUNDS WALK_SETTLED WEIGHED_AT_MOST WIDER
    """,
    "inference": """
        BANDS BEGINNING CANCELLED DAMPING DAMPINGS DIFFERENCE EQUAL EVALUATIONS FACTORS_KEPT FAILED
        FINALISTS FINE FIRST_ROUNDS FISHER_STEPS FREQUENCIES HALVED HATS LARGEST LARGEST_KEPT LAST_GAIN
        LEARNINGS LEAST_WHITE LOWEST MEMORIES MOST_SAMPLES PARTED PIVOTS RATIO REMEMBERED RESAMPLED RESTORED
        RIDGE ROUGHLY SAME_INPUT SCATTERS SEARCH_ROUNDS SLOPE SMALLEST_SHARE SPANS SPARING STARTS THIRD TINY
    """,
}


def files(package: str) -> list[Path]:
    """The modules of a package."""
    return sorted((TOP / "cosim" / package).rglob("*.py"))


@cache
def parsed(path: Path) -> ast.Module:
    """A module, read once for all tests."""
    return ast.parse(path.read_text(encoding="utf-8"))


def constants(tree: ast.Module) -> Iterator[tuple[str, ast.expr]]:
    """(name, value) of each module-level constant, private ones included."""
    for node in tree.body:
        targets = node.targets if isinstance(node, ast.Assign) else [getattr(node, "target", None)]
        for target in targets:
            pairs = [(target, node.value)] if isinstance(target, ast.Name) else []
            if isinstance(target, ast.Tuple) and isinstance(node.value, ast.Tuple):
                pairs = list(zip(target.elts, node.value.elts, strict=True))
            for name, value in pairs:
                if isinstance(name, ast.Name) and name.id.isupper() and value is not None:
                    yield name.id, value


def numeric(value: ast.expr) -> bool:
    """True for a number, an expression of numbers or a collection of nothing else."""
    if isinstance(value, ast.Constant):
        return isinstance(value.value, int | float) and not isinstance(value.value, bool)
    if isinstance(value, ast.UnaryOp):
        return numeric(value.operand)
    if isinstance(value, ast.BinOp):
        return numeric(value.left) or numeric(value.right)
    if isinstance(value, ast.Tuple | ast.List | ast.Set):
        return bool(value.elts) and all(map(numeric, value.elts))
    if isinstance(value, ast.Call):
        made = (
            isinstance(value.func, ast.Name) and value.func.id[0].isupper()
        )  # an object of a class is no number
        return not made and any(map(numeric, value.args))
    return False


def outside(tree: ast.Module, allowed: Collection[str]) -> list[str]:
    """Names of numbers that a module has of its own though they are not among the allowed ones."""
    return [n for n, value in constants(tree) if numeric(value) and n not in allowed]


def compared(tree: ast.Module) -> list[float]:
    """Numbers that stand in a comparison, but 0, 1/2, 1 and 2 and those as small as rounding."""
    found = []
    for node in ast.walk(tree):
        for side in (node.left, *node.comparators) if isinstance(node, ast.Compare) else ():
            found += [
                leaf.value
                for leaf in ast.walk(side)
                if isinstance(leaf, ast.Constant) and isinstance(leaf.value, float)
                if abs(leaf.value) > 1e-3 and leaf.value not in (0.5, 1.0, 2.0)
            ]
    return found


def test_a_threshold_beside_the_code_is_found() -> None:
    source = "A, B = 1.0, 'b'\nPAIR = (1.0 / 3.0, 3)\nNAMES = ('a',)\nNONE = Event(1.0)\nFINE: int = 4\nALSO = 2 * A\n"
    assert outside(ast.parse(source), {"FINE"}) == ["A", "PAIR", "ALSO"]
    assert compared(ast.parse("x > 3.5 * y and x < 1e-9 and abs(x) <= 0.5 * y")) == [3.5]


@pytest.mark.parametrize("package", TABLES)
def test_a_new_threshold_goes_into_the_table(package: str) -> None:
    table = Path(TABLES[package].__file__)
    found = {
        path.stem: names
        for path in files(package)
        if path != table and (names := outside(parsed(path), NUMERICAL[package].split()))
    }
    assert not found, f"give them a line in {table.relative_to(TOP)}, with unit, reason and where measured"


# a median of gaps, a step beside the samples', the square root of a sum of binomials, the highest thousandth
COMPARED = {
    "signatures": [1.5, 70.0],
    "pace": [1.5],
    "reference": [1.5],
    "labels": [0.999],
    "beginning": [20.0],
}


@pytest.mark.parametrize("package", TABLES)
def test_no_comparison_holds_a_threshold_without_a_name(package: str) -> None:
    found = {p.stem: numbers for p in files(package) if (numbers := compared(parsed(p)))}
    assert {name: numbers for name, numbers in found.items() if sorted(numbers) != COMPARED.get(name)} == {}


@pytest.mark.parametrize("package", TABLES)
def test_no_name_has_two_values(package: str) -> None:
    values = defaultdict(set)
    for path in files(package):
        for name, value in constants(parsed(path)):
            values[name].add(ast.dump(value))
    assert not [name for name, each in values.items() if len(each) > 1]


@pytest.mark.parametrize("package", TABLES)
def test_the_list_of_numerical_settings_names_no_other(package: str) -> None:
    present = {n for p in files(package) for n, _ in constants(parsed(p))}
    allowed = set(NUMERICAL[package].split())
    assert allowed <= present
    assert not allowed & {one.name for one in listed(TABLES[package])}


@pytest.mark.parametrize("package", TABLES)
def test_each_line_says_what_why_and_where_and_is_used(package: str) -> None:
    module = TABLES[package]
    lines = listed(module)
    named = {n for n, _ in constants(parsed(Path(module.__file__)))}
    assert {line.name for line in lines} == named
    assert all(all(text.strip() for text in line[2:]) for line in lines)
    used = {
        alias.name
        for path in (TOP / "cosim").rglob("*.py")
        if module.__name__ in path.read_text(encoding="utf-8")  # to parse the others takes seconds
        for node in ast.walk(parsed(path))
        if isinstance(node, ast.ImportFrom) and node.module == module.__name__
        for alias in node.names
    }
    assert named <= used


def test_the_page_is_current() -> None:
    spec = importlib.util.spec_from_file_location("make_thresholds", TOP / "docs" / "make_thresholds.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    text = (TOP / "docs" / "thresholds.md").read_text(encoding="utf-8")
    assert module.written(text) == text, "run: python docs/make_thresholds.py"
    assert "`NAMING_GAIN` | 10 log-likelihood" in text
