"""A native FMU at work in real time: its steps ask nothing of the system, allocate nothing and know no locks."""

import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from benchmarks.real_time import EFFECTS, calls_while_stepping, host

# pure computations, of libm and on memory that is there
COMPUTING = {
    "acos", "acosh", "asin", "asinh", "atan", "atan2", "atanh", "ceil", "copysign", "cos", "cosh",
    "erf", "erfc", "exp", "expm1", "fabs", "floor", "fmod", "log", "log10", "log1p", "log2", "pow",
    "sin", "sincos", "sinh", "sqrt", "tan", "tanh", "trunc", "memcpy", "memset", "memmove", "memcmp",
    "strlen", "strcmp", "strncmp", "strchr", "strcspn", "strcpy", "strncpy", "strtod", "sprintf",
    "snprintf", "vsnprintf", "__stack_chk_fail",
}  # fmt: skip
# to make an instance, read its table, save a state: outside of a step
AT_THE_START = {
    "fopen",
    "fclose",
    "fgets",
    "fread",
    "calloc",
    "malloc",
    "realloc",
    "free",
    "ferror",
    "feof",
    "strtol",
}


@pytest.fixture(scope="module")
def at_work(tmp_path_factory):
    """The chain with effects of each kind on, in the host with a fixed rate."""
    if not sys.platform.startswith("linux"):
        pytest.skip("the host is for Linux")
    return host(tmp_path_factory.mktemp("real_time"), EFFECTS)


def test_no_allocation_and_no_page_of_memory_while_it_steps(at_work) -> None:
    found = at_work.run(20_000, 0)
    assert found["allocations"] == 0
    assert abs(found["output"]) > 1e-3  # it moves
    assert found["half"] < 100_000  # ns, a tenth of the period even without speed and on a busy machine


def test_rate_is_kept(at_work) -> None:
    found = at_work.run(300)
    assert found["allocations"] == 0
    assert 0.0 <= found["late_half"] <= found["late_p999"] <= found["late_most"]
    assert found["half"] <= found["p999"] <= found["most"]


def test_no_system_call_while_it_steps(at_work, tmp_path) -> None:
    try:
        found = calls_while_stepping(at_work, 5_000, tmp_path)
    except RuntimeError as error:
        pytest.skip(str(error))
    assert found == []


def test_a_system_call_would_be_seen(at_work, tmp_path) -> None:
    """At a rate the host itself sleeps once a step."""
    given = type("Slow", (), {"command": lambda self, steps, period: at_work.command(20, 1_000_000)})()
    try:
        found = calls_while_stepping(given, 20, tmp_path)
    except RuntimeError as error:
        pytest.skip(str(error))
    assert sum("clock_nanosleep" in line for line in found) == 20


def test_library_knows_no_locks_and_no_clock(at_work) -> None:
    """Symbols that it takes from elsewhere."""
    if shutil.which("nm") is None:
        pytest.skip("nm is not installed")
    library = Path(at_work.words[0])
    said = subprocess.run(
        ["nm", "-D", "--undefined-only", library], capture_output=True, text=True, check=True
    ).stdout
    names = {line.split()[-1].partition("@")[0] for line in said.splitlines()}
    own = {n for n in names if not n.startswith(("_ITM_", "__gmon", "__cxa_finalize", "__errno_location"))}
    assert own <= COMPUTING | AT_THE_START
    assert "tanh" in own
