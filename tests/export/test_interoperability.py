"""The table of clients: a client that fails or differs is told from one that agrees, and the committed page is whole."""

import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

from benchmarks import interoperability
from benchmarks.interoperability import Trials
from benchmarks.interoperability_page import CLIENTS, KINDS, Row, page
from cosim.errors import ModelError

STEPS = 120
PAGE = Path(interoperability.__file__).parent.parent / "docs" / "interoperability.md"


@pytest.fixture
def trials(built, tmp_path):
    """Trials of one kind and one system."""
    return Trials({"pythonfmu": {"full_order": built["full_order"]}}, tmp_path, STEPS)


def needs_host(trials):
    why = trials.unavailable("host+python")
    if why:
        pytest.skip(why)


def test_our_runner_agrees_with_the_blocks(trials):
    row = trials.row("pythonfmu", "cosim")
    assert (row.loads, row.runs, row.agrees, row.ends, row.reasons) == (True, True, True, True, [])
    expected = trials.reference("pythonfmu", "cosim", "full_order")
    assert all(np.ptp(values) > 0.0 for values in expected.values())  # nothing agrees by standing still


@pytest.mark.slow
def test_reference_of_the_loop_is_our_runner_s(built, tmp_path):
    row = Trials({"pythonfmu": {"physical": built["physical"]}}, tmp_path, STEPS).row("pythonfmu", "cosim")
    assert row.agrees, row.reasons


def test_plain_host_gives_the_same_numbers(trials):
    needs_host(trials)
    row = trials.row("pythonfmu", "host+python")
    assert (row.loads, row.runs, row.agrees, row.ends) == (True, True, True, True), row.reasons


def test_plain_host_without_python_fails_for_the_known_reason(trials):
    needs_host(trials)
    row = trials.row("pythonfmu", "host")
    assert (row.loads, row.runs, row.agrees, row.ends) == (False, False, False, False)
    assert "undefined symbol: _Py_NoneStruct" in row.reasons[0]
    assert "/" not in row.reasons[0].split(": ", 1)[1].split()[3]  # no folder of this machine


@pytest.mark.slow
def test_another_scheme_is_seen(trials, monkeypatch):
    """Were our runner compared with masters that delay each wire by one step, it would not agree."""
    monkeypatch.setitem(interoperability.SCHEMES, "cosim", {"first_input_zero": False})
    row = trials.row("pythonfmu", "cosim")
    assert (row.runs, row.agrees) == (True, False)
    assert row.difference > 1e-4
    assert "of a signal's range" in row.reasons[0]


def test_client_that_fails_later_is_a_failure_of_running(trials, monkeypatch):
    good = Trials.run

    def run(self, client, package, steps, signals):
        if steps > 1:
            raise RuntimeError("ended with -11: ")
        return good(self, client, package, steps, signals)

    monkeypatch.setattr(Trials, "run", run)
    row = trials.row("pythonfmu", "cosim")
    assert (row.loads, row.runs, row.agrees, row.ends) == (True, False, False, False)
    assert row.reasons == ["full_order: ended with -11:"]


def test_package_that_is_no_package(tmp_path):
    broken = tmp_path / "full_order.ssp"
    broken.write_bytes(b"no archive")
    row = Trials({"pythonfmu": {"full_order": broken}}, tmp_path, STEPS).row("pythonfmu", "cosim")
    assert (row.loads, row.runs, row.agrees, row.ends) == (False, False, False, False)
    assert str(tmp_path) not in row.reasons[0]


def test_host_reports_a_bad_plan(trials, tmp_path):
    needs_host(trials)
    plan = tmp_path / "plan.txt"
    plan.write_text("component a /nowhere/a.so file:///nowhere {0}\n")
    done = subprocess.run(
        [str(trials.host), str(plan), "1", "0.001"], capture_output=True, text=True, check=False
    )
    assert (done.returncode, "a.so" in done.stderr) == (2, True)
    plan.write_text("nonsense 1\n")
    done = subprocess.run(
        [str(trials.host), str(plan), "1", "0.001"], capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stderr) == (1, "bad plan at 'nonsense'\n")


def test_only_what_is_built_is_tried(built, tmp_path):
    with pytest.raises(ModelError, match=r"run `python build_fmus\.py` first"):
        interoperability.built(tmp_path)
    (tmp_path / "native" / "ssp").mkdir(parents=True)
    shutil.copy(built["physical"], tmp_path / "native" / "ssp" / "physical.ssp")
    assert interoperability.built(tmp_path) == {"native": {"physical": tmp_path / "native/ssp/physical.ssp"}}


def test_page_says_what_failed_and_what_was_not_built():
    rows = [
        Row(
            "pythonfmu",
            "ecos",
            True,
            True,
            False,
            True,
            0.5,
            ["full_order: differs by 0.5 of a signal's range"],
        ),
        Row("pythonfmu", "libcosim", reasons=["libcosimpy is not installed"]),
    ]
    text = page(rows, {"pythonfmu": (22, ["a.fmu: bad"])}, 100)
    assert "| pythonfmu | ecos | yes | yes | **no** | yes | 5.0e-01 |" in text
    assert "| pythonfmu | libcosim | not tried | not tried | not tried | not tried |  |" in text
    assert "libcosim: libcosimpy is not installed" in text
    assert "The kind `native` was not built" in text
    assert "22 FMUs in the packages, 1 problems\n  - a.fmu: bad" in text


def test_committed_page_has_a_row_for_every_kind_and_client():
    rows = [
        line.split(" | ")[:2]
        for line in PAGE.read_text(encoding="utf-8").splitlines()
        if line.startswith("| ")
    ]
    found = {(kind.removeprefix("| "), client) for kind, client in rows}
    assert found >= {(kind, label) for kind in KINDS for label in CLIENTS.values()}
    assert "| not tried |" not in PAGE.read_text(encoding="utf-8")
