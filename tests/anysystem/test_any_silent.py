"""A model that is far off comes nearer by whatever silences it: that is no cause."""

import json
from contextlib import nullcontext
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from benchmarks.systems import parts
from cosim.anysystem.pipeline import far_off
from cosim.anysystem.search.known import MOST_COARSE, Known
from cosim.errors import SimulationError
from cosim.inference.problem import Problem
from cosim.inference.unknowns import Unknown

N, H = 1500, 0.01


def written(folder: Path, share: float, slow: float, noise: float) -> tuple[Path, Path]:
    """An FMU of a lag, and a log of `share` of its output, of a slow movement that nothing in the model makes, of noise."""
    rng = np.random.default_rng(5)
    u = np.repeat(rng.uniform(-1.0, 1.0, N // 100), 100)
    x = np.zeros(N)
    for k in range(1, N):
        x[k] = x[k - 1] + (1.0 - np.exp(-H)) * (u[k - 1] - x[k - 1])
    y = share * x + slow * np.sin(2.0 * np.pi * 0.23 * H * np.arange(N)) + noise * rng.standard_normal(N)
    rows = [f"{H * k:.2f},{a!r},{b!r}" for k, (a, b) in enumerate(zip(u.tolist(), y.tolist(), strict=True))]
    log = folder / "log.csv"
    log.write_text("\n".join(["time [s],part_lag.u [1],part_lag.y [1]", *rows]) + "\n", encoding="utf-8")
    return parts.native("lag", folder), log


def diagnosed(command, folder: Path, fmu: Path, log: Path) -> dict:
    code, out, err = command("diagnose", log, "--model", fmu, "--out", folder / "o", "--json")
    assert code == 0, err
    return json.loads(out)


@pytest.mark.skipif(parts.COMPILER is None, reason="no C compiler")
def test_what_silences_a_model_that_has_nothing_to_do_with_the_log_is_no_cause(
    command, tmp_path: Path
) -> None:
    """A dead zone as wide as the command was named, beside a gain of zero."""
    found = diagnosed(command, tmp_path, *written(tmp_path, 0.0, 0.02, 0.0005))
    assert (found["verdict"], found["causes"]) == ("unexplained", [])
    said = " ".join(r["why"] for r in found["refused"])
    assert "no more of the log than a constant" in said or "may be zero" in said
    assert any("check units, signs" in w for w in found["warnings"])
    assert any("check units, signs" in text for text in found["advice"])  # which the terminal shows


def test_how_far_a_model_is_off_is_told_of_its_own_run() -> None:
    """What a nuisance takes out of an error, such as a trusted number within its tolerance, no simulation takes out."""
    ramp = np.linspace(0.0, 1.0, 100)
    problem = Problem(
        {"a.y#0": ramp},
        {"a.y#0": np.ones(100, dtype=np.bool_)},
        {"a.y#0": np.zeros(100, dtype=np.int64)},
        lambda values: {"a.y#0": 9.0 * ramp},
        {"a.y#0": 1e-3},
    )
    problem.share([Unknown("parameter|a.K", -np.inf, np.inf, 1.0, 100.0)], {"a.y#0": ramp[None, :]})
    finding = SimpleNamespace(
        problem=problem,
        null=SimpleNamespace(fit=SimpleNamespace(values={})),
        model=SimpleNamespace(whole=lambda series, signal: series[f"{signal}#0"]),
        spreads={"a.y": float(np.std(ramp))},
        unexplained={"a.y": "far off"},
    )
    (said,) = far_off(finding)  # type: ignore[arg-type]
    size = float(said.partition("errs ")[2].split()[0])
    assert size == pytest.approx(8.0 * np.sqrt(np.mean(ramp**2)) / np.std(ramp), rel=0.05)


def test_the_error_of_a_solver_is_none_of_a_reading_that_is_far_smaller() -> None:
    """Of a model in millimetres beside a reading in metres its error would make everything noise."""
    wave, finer = np.sin(0.1 * np.arange(500)), 1.01

    class Model:
        """Whose run at finer steps differs by a hundredth."""

        runs = SimpleNamespace(finer=nullcontext, can_halve=lambda unit, h: True)
        segments = (SimpleNamespace(h=0.01),)
        cuts = ()
        system = SimpleNamespace(components={"a": SimpleNamespace(fmu=SimpleNamespace(tolerance=None))})
        group = SimpleNamespace(components=("a",), judged=(("a.y", None),))

        def __init__(self, size: float) -> None:
            self.own = {"a.y": size * wave}

        def __call__(self, values: dict[str, float]) -> dict[str, np.ndarray]:
            return {"a.y": finer * self.own["a.y"]}

        def whole(self, series: dict[str, np.ndarray], signal: str) -> np.ndarray:
            return series[signal]

    def coarse(size: float) -> float:
        known = Known.__new__(Known)
        known.model = Model(size)  # type: ignore[assignment]
        known.spreads, known.base = {"a.y": float(np.std(wave))}, {}
        return known._coarse(known.model.own)["a.y"]  # type: ignore[arg-type]

    assert coarse(1.0) == pytest.approx(0.02 * np.std(wave))
    assert coarse(1000.0) == pytest.approx(0.02 * np.std(wave))
    assert coarse(0.1) == pytest.approx(0.002 * np.std(wave))
    # a model that is another one with half the step: all its errors passed for its solver's, and it was adequate
    finer = -1.0
    assert coarse(1.0) == pytest.approx(MOST_COARSE * np.std(wave))


@pytest.mark.parametrize(
    ("gain", "size"),
    [(2e-4, 1e4), (0.5, 1.0), (50.0, 0.01), (0.0, 1.0)],
    ids=["Pa", "about 1", "rad", "none"],
)
def test_a_parameter_of_zero_is_looked_for_in_the_decade_that_moves_the_model(
    gain: float, size: float
) -> None:
    """One of its FMU's unit was the size of a friction that is off: 20 N were beyond twenty of them."""
    wave = np.sin(0.1 * np.arange(500))
    known = Known.__new__(Known)
    known.base, known.spreads = {}, {"a.y": float(np.std(wave))}
    known.trusted, known.free = {"a.friction": (0.0, 0.01), "a.mass": (-3.0, 0.01)}, {}

    class Model(SimpleNamespace):
        def __call__(self, values: dict[str, float]) -> dict[str, np.ndarray]:
            if abs(values["parameter|a.friction"]) > 1e7:
                raise SimulationError("it runs away")
            return {"a.y": wave * (1.0 + gain * values["parameter|a.friction"])}

    known.model = Model(whole=lambda series, signal: series[signal])  # type: ignore[assignment]
    scales = known._scales({"a.y": wave})
    assert scales == {"a.friction": pytest.approx(size), "a.mass": 3.0}


@pytest.mark.skipif(parts.COMPILER is None, reason="no C compiler")
def test_a_wire_that_is_broken_is_a_gain_of_zero(command, tmp_path: Path) -> None:
    """Nothing stays wrong: what is read is noise alone."""
    found = diagnosed(command, tmp_path, *written(tmp_path, 0.0, 0.0, 0.0005))
    assert found["verdict"] == "explained"
    names = {c["effect"] for c in found["causes"]}
    alike = {a.split()[0] for c in found["causes"] for a in c["indistinguishable_from"]}
    assert "port.gain" in names | alike
