"""A parameter that the mapping takes as exact is asked where nothing else explains a log."""

from pathlib import Path

import numpy as np
import pytest

from benchmarks.any_system import COUNT, Case, H, log_of, named
from benchmarks.systems import parts
from cosim.anysystem.answer import answer
from cosim.anysystem.options import AnyOptions
from cosim.anysystem.pipeline import diagnose_system
from cosim.anysystem.read import Column, Recording
from cosim.diagnosis.answer.schema import Answer
from cosim.ssp.read import read_system
from cosim.system.runs import Runs


def arm(zeta: float) -> Case:
    """An arm that stiffens, whose damping is so many times that of its model: nothing at its ports does the same."""
    return Case(
        71,
        "numbers",
        {"arm": "stiffening"},
        {"arm": {"K": 1.2, "W": 6.0, "ZETA": 0.5, "C": 0.4}},
        [("command", "arm.u")],
        ["command", "arm.y"],
        numbers={"arm.ZETA": (0.5, zeta)} if zeta != 1.0 else {},
    )


def found(case: Case, fmus: dict[str, Path], folder: Path, trusted: list[str]) -> Answer:
    package = parts.write_ssp(
        folder / "arm.ssp", {n: fmus[k] for n, k in case.kinds.items()}, case.wires, case.values
    )
    signals = log_of(case)
    log = Recording(
        folder / "log.csv", H * np.arange(COUNT), signals, {n: Column(n, n, "1", 1.0, 0.0) for n in signals}
    )
    with read_system(package) as system, Runs(system, apart=False) as runs:
        options = AnyOptions(trusted=dict.fromkeys(trusted))
        return answer(diagnose_system(system, [log], runs, options))


def test_a_parameter_taken_as_exact_is_named_where_nothing_else_explains_the_log(
    fmus: dict[str, Path], tmp_path: Path
) -> None:
    said = found(arm(0.3), fmus, tmp_path, ["arm.K", "arm.W"])
    assert [named(c) for c in said.causes] == ["parameter arm.ZETA"]
    assert said.verdict == "explained"
    assert said.causes[0].parameters["ZETA"].value == pytest.approx(0.15, rel=0.05)
    assert any("taken as exact" in text for text in said.warnings)


def test_a_parameter_taken_as_exact_stays_so_where_the_log_is_explained(
    fmus: dict[str, Path], tmp_path: Path
) -> None:
    said = found(arm(1.0), fmus, tmp_path, ["arm.K", "arm.W"])
    assert said.verdict == "adequate"
    assert not any("taken as exact" in text for text in said.warnings)
