"""Groups that a reading of their own drives, and what is the same as a named cause."""

from collections.abc import Mapping
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from benchmarks.any_system import Case, make_case, run, score, told
from benchmarks.systems import parts
from benchmarks.systems.truth import Hidden
from cosim.anysystem.actions import Action
from cosim.anysystem.search.decisions import Decisions
from cosim.anysystem.search.finding import Candidate
from cosim.anysystem.search.fits import Fits
from cosim.anysystem.search.known import Known
from cosim.anysystem.search.rivals import Rivals
from cosim.anysystem.search.screening import Screening
from cosim.diagnosis.budget import Budget
from cosim.inference.held_out import HeldOutGain
from cosim.inference.noise import Noise
from cosim.inference.problem import Fit, Problem
from cosim.inference.unknowns import Unknown
from cosim.ssp.system import Port

KINDS = {"valve": "lag", "plant": "second", "sum": "sum"}
VALUES = {
    "valve": {"K": 1.0, "T": 0.1},
    "plant": {"K": 0.9, "W": 6.0, "ZETA": 0.6},
    "sum": {"K": 0.8, "C": 0.6, "T": 0.15},
}
# what the valve gives was not measured and drives two: so the reading of the plant drives its own group
WIRES = [("command", "valve.u"), ("valve.y", "plant.u"), ("plant.y", "sum.u"), ("valve.y", "sum.v2")]
MEASURED = ["command", "plant.y", "sum.y"]


def case(kind: str, *hidden: Hidden) -> Case:
    return Case(5, kind, KINDS, VALUES, WIRES, MEASURED, list(hidden))


@pytest.mark.parametrize(
    ("where", "effect", "values"),
    [
        pytest.param("sensor", "port.rate_limit", {"rate": 1.5}, marks=pytest.mark.slow),
        ("output", "port.gain", {"gain": 0.8}),
    ],
)
def test_a_reading_that_drives_its_own_group_is_told_from_the_quantity(
    fmus: dict[str, Path], tmp_path: Path, where: str, effect: str, values: dict[str, float]
) -> None:
    hidden = case("port", Hidden(effect, "plant.y", where, values))
    found, _, _ = run(hidden, fmus, tmp_path)
    assert all(score(hidden, found).values())
    (cause,) = found.causes
    other = "output" if where == "sensor" else "sensor"
    assert f"{effect} at plant.y ({other})" not in cause.indistinguishable_from


def test_numbers_of_which_only_their_sum_counts_are_declared_alike(
    fmus: dict[str, Path], tmp_path: Path
) -> None:
    values = {"sum": {"K": 0.94, "C": -0.88, "T": 0.37}}
    only = Case(
        10,
        "parameter",
        {"sum": "sum"},
        values,
        [("command", "sum.u"), ("command", "sum.v2")],
        ["command", "sum.y"],
        numbers={"sum.K": (0.94, 1.59)},
    )
    found, _, _ = run(only, fmus, tmp_path)
    (cause,) = found.causes
    assert {"parameter sum.K", "parameter sum.C"} <= told(cause)


def test_a_log_that_bends_what_is_trusted_to_its_limits_says_so(
    fmus: dict[str, Path], tmp_path: Path
) -> None:
    """Two gains of 1 and -0.9 of one signal: 3 % of each change their sum by half."""
    bent = Case(
        10,
        "parameter",
        {"valve": "lag", "sum": "sum"},
        {"valve": {"K": 1.2, "T": 0.2}, "sum": {"K": 1.0, "C": -0.85, "T": 0.3}},
        [("command", "valve.u"), ("valve.y", "sum.u"), ("valve.y", "sum.v2")],
        ["command", "sum.y"],
        numbers={"valve.K": (1.2, 1.35)},
    )
    found, _, _ = run(bent, fmus, tmp_path)
    assert found.verdict == "adequate"
    (text,) = (w for w in found.warnings if "three deviations" in w)
    assert "sum.K" in text
    assert "valve.K" in text


def test_an_estimate_that_a_switch_within_a_component_holds_is_left_for_a_better_one() -> None:
    """A valve that a level opens moves by whole steps of the program: so does the likelihood."""
    size = Unknown("parameter|tank.r", 0.1, 20.0, 1.4)
    action = Action("parameter", Port("tank", "r"))
    time = np.linspace(0.0, 1.0, 1500)

    def model(values: Mapping[str, float]) -> dict[str, np.ndarray]:
        step = round((values[size.name] - 9.1) / 0.06)
        held = abs(step) if step != -3 else 0.5  # three steps away it is nearly as good as at none
        return {"tank.y#0": np.sin(9.0 * time) * (1.0 + 0.1 * held)}

    rng = np.random.default_rng(1)
    windows = np.arange(1500) // 50
    measured = np.sin(9.0 * time) + 0.01 * rng.normal(size=1500)
    problem = Problem(
        {"tank.y#0": measured},
        {"tank.y#0": windows % 3 != 1},
        {"tank.y#0": windows},
        model,
        {"tank.y#0": 1e-4},
    )
    problem.noise["tank.y#0"] = Noise(1e-4)
    known = Known.__new__(Known)
    known.problem, known.budget, known.trusted = problem, Budget(), {"tank.r": (7.0, 0.01)}
    known.scales, known.spreads, known.wide = {"tank.r": 7.0}, {}, []
    known.model = SimpleNamespace(  # type: ignore[assignment]
        group=SimpleNamespace(judged=(("tank.y", Port("tank", "y")),)),
        segments=[
            SimpleNamespace(signals={"tank.y": measured}, known=lambda _: np.ones(1500, dtype=np.bool_))
        ],
        known=lambda _: np.ones(1500, dtype=np.bool_),
        judging=lambda _: [0],
        places=lambda signal: [f"{signal}#0"],
        whole=lambda series, signal: series[f"{signal}#0"],
        system=SimpleNamespace(variable=lambda _: SimpleNamespace(low=0.1, high=20.0)),
    )
    stuck = problem.fit([size], {size.name: 8.92})
    assert stuck is not None
    assert abs(stuck.values[size.name] - 9.1) > 0.1
    fits = Fits(known)
    found = fits.elsewhere(fits.scored(Candidate((action,), stuck, 0.0)))
    assert abs(found.fit.values[size.name] - 9.1) < 0.03


@pytest.mark.slow
def test_what_others_say_of_a_reading_holds_for_each_group_that_it_drives(tmp_path):
    """An output that is off drives two groups: one cannot tell, took the reading for wrong and lacked a gain."""
    if parts.COMPILER is None:
        pytest.skip("no C compiler")
    case = make_case(7012)
    (gain, _) = case.hidden
    assert (gain.effect, gain.port, gain.where) == ("port.gain", "part2.y", "output")
    fmus = {kind: parts.native(kind, tmp_path) for kind in set(case.kinds.values())}
    found, _, _ = run(case, fmus, tmp_path)
    assert score(case, found)["exact"], [told(c) for c in found.causes]


def test_what_is_held_against_a_cause_has_the_nuisances_that_are_now() -> None:
    """Asked again, the nuisances may be others, and more: the two hypotheses could not be compared (exit code 4)."""
    rng = np.random.default_rng(3)
    ramp, windows = np.linspace(0.0, 1.0, 300), np.arange(300) // 30
    problem = Problem(
        {"a.y#0": ramp + 0.01 * rng.standard_normal(300)},
        {"a.y#0": windows < 7},
        {"a.y#0": windows},
        lambda values: {"a.y#0": values.get("parameter|a.K", 0.9) * ramp},
        {"a.y#0": 1e-3},
    )

    def shared(count: int) -> None:
        own = [Unknown(f"shift:{k}", -1.0, 1.0, 1.0, 0.01) for k in range(count)]
        problem.share(own, {"a.y#0": np.stack([np.sin((k + 2) * ramp) for k in range(count)])})

    known = Known.__new__(Known)
    known.problem, known.budget, known.spreads = problem, Budget(), {}
    known.model = SimpleNamespace()  # type: ignore[assignment]
    fits = Fits(known)
    decisions = Decisions(Rivals(Screening(fits, 3)))
    action = Action("parameter", Port("a", "K"))
    best, poorer = (
        Candidate(actions, Fit(values, np.zeros((0, 0)), (), np.zeros(0), 0.0), 0.0)
        for actions, values in (((action,), {"parameter|a.K": 1.0}), ((), {}))
    )
    fits.price = lambda actions: 0.0  # type: ignore[method-assign, assignment]
    decisions._other_log = lambda: True  # type: ignore[method-assign]
    fits.fit = lambda *asked: None  # type: ignore[method-assign, assignment]
    shared(3)
    fits.scored(best)
    decisions._without = lambda *asked: poorer  # type: ignore[method-assign, assignment]
    problem.held_out = lambda richer, poorer: HeldOutGain(1.0, 5.0)  # type: ignore[method-assign]

    def settled(candidate: Candidate) -> None:
        shared(3 if fits.steady else 4)
        fits.scored(candidate)

    fits.settle = settled  # type: ignore[method-assign]
    found, judged = decisions._held_out(best, poorer)
    assert not judged[action][1].sure
    rows = [c.fit.rows for c in (found, judged[action][0])]
    assert [r.size for r in rows] == [304, 304]
    assert np.isfinite([problem.pull(r) for r in rows]).all()
