"""Hypotheses about a model that is a plain Python function: known answers, and the example that the documentation prints."""

import importlib.util
import re
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from cosim.errors import SimulationError
from cosim.inference.hypotheses import Hypothesis, Judgement, judged, problem_of
from cosim.inference.thresholds import FITTED_WINDOWS
from cosim.inference.unknowns import Unknown

TOP = Path(__file__).resolve().parents[2]
N = 600
T = 0.05 * np.arange(N)
U = np.sin(T) + 0.5 * np.sin(3.7 * T)
GAIN, SQUARE = Unknown("gain", -5.0, 5.0, 0.3), Unknown("bend", -5.0, 5.0, 0.1)
STRAIGHT = Hypothesis("straight", (GAIN,), {"gain": 0.5})
CURVED = Hypothesis("with a square", (GAIN, SQUARE), {"gain": 0.5, "bend": 0.0})


def model(values):
    """A straight line and a square; it cannot be run beyond a gain of 3."""
    if values["gain"] > 3.0:
        raise SimulationError("the spring broke")
    return {"y": values["gain"] * U + values.get("bend", 0.0) * U**2}


def data(seed, bend=0.0, noise=0.05):
    """Data of the line, or of the square as well, in white noise."""
    return {"y": 1.2 * U + bend * U**2 + noise * np.random.default_rng(seed).standard_normal(N)}


@pytest.fixture(scope="module")
def example() -> ModuleType:
    spec = importlib.util.spec_from_file_location("coast_down", TOP / "examples" / "coast_down.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="module")
def compared(example: ModuleType) -> dict[float, tuple[Judgement, ...]]:
    return {seconds: example.compared(seconds) for seconds in (20.0, 60.0)}


def test_a_score_is_that_of_generalised_least_squares_less_half_the_logarithm_of_the_samples() -> None:
    problem = problem_of(data(1, bend=0.05), model, {"y": 1e-4})
    found = {one.hypothesis.name: one for one in judged(problem, [STRAIGHT, CURVED])}
    inside = problem.fitted["y"]
    y, *columns = (problem.whitened({"y": series})[0][inside] for series in (problem.measured["y"], U, U**2))
    for name, count in (("straight", 1), ("with a square", 2)):
        exact, left = np.linalg.lstsq(np.stack(columns[:count], axis=1), y, rcond=None)[:2]
        score = -0.5 * float(left[0]) - 0.5 * count * np.log(inside.sum())
        assert found[name].score == pytest.approx(score, rel=1e-6)  # a straight line is fitted to rounding
        assert found[name].fit.values["gain"] == pytest.approx(exact[0], rel=1e-5)
    # white noise of 0.05 is learned as such
    assert problem.noise["y"].rms == pytest.approx(0.05, rel=0.1)


def test_what_is_not_there_is_hardly_ever_preferred_and_what_is_there_always() -> None:
    wrong = sum(
        judged(problem_of(data(seed), model, {"y": 1e-4}), [STRAIGHT, CURVED])[0].hypothesis is CURVED
        for seed in range(20)
    )
    assert wrong <= 1  # BIC of 400 values: chi-square beyond 6.0, 1.4 % of the logs
    for seed in range(3):
        found = judged(problem_of(data(seed, bend=0.1), model, {"y": 1e-4}), [STRAIGHT, CURVED])
        assert found[0].hypothesis is CURVED
        assert found[0].gain.sure
        assert not found[1].gain.sure  # over itself it gains nothing
        assert found[0].fit.values["bend"] == pytest.approx(0.1, rel=0.3)


def test_intervals_hold_the_truth_as_often_as_they_say() -> None:
    inside = 0
    for seed in range(20):
        (one,) = judged(problem_of(data(seed), model, {"y": 1e-4}), [STRAIGHT])
        low, high = one.ci95("gain")
        inside += low < 1.2 < high
    assert inside >= 16  # 19 of 20 on average; fewer in one of four hundred such tests


def test_windows_held_out_visit_the_whole_record() -> None:
    problem = problem_of(data(1), model, {"y": 1e-4})
    out = ~problem.fitted["y"]
    assert out.mean() == pytest.approx(1.0 / 3.0, abs=0.01)
    assert len(np.unique(problem.window["y"][out])) == FITTED_WINDOWS / 3
    assert np.flatnonzero(out)[0] < N / 10
    assert np.flatnonzero(out)[-1] > 0.9 * N


def test_a_model_that_cannot_be_run_is_named_with_its_own_words() -> None:
    problem = problem_of(data(1), model, {"y": 1e-4})
    with pytest.raises(SimulationError, match=r"'stiff' cannot be run at \{'gain': 4\.0\}: the spring broke"):
        judged(problem, [Hypothesis("stiff", (GAIN,), {"gain": 4.0})])


def test_a_record_too_short_for_its_windows_is_refused() -> None:
    with pytest.raises(ValueError, match="y has 40 samples: give 60 or more"):
        problem_of({"y": U[:40]}, model, {"y": 1e-4})


def test_the_example_tells_what_stopped_the_wheel_from_a_record_that_shows_it(compared) -> None:
    found = compared[60.0]
    assert found[0].hypothesis.name == "dry, air"
    for name, truth in (("dry", 0.4), ("air", 2.0)):
        low, high = found[0].ci95(name)
        assert low < truth < high
    richer = next(one for one in found if one.hypothesis.name == "all three")
    assert all(found[0].score > one.score + 6.0 for one in found if one not in (found[0], richer))
    # the first 20 s leave open whether it is dry friction: what cannot be told apart stays side by side
    short = {one.hypothesis.name: one for one in compared[20.0]}
    assert abs(short["dry, air"].score - short["viscous, air"].score) < 6.0


def test_the_page_prints_what_the_example_prints(example, compared) -> None:
    page = (TOP / "docs" / "inference.md").read_text(encoding="utf-8").splitlines()
    number = re.compile(r"-?\d+(?:\.\d+)?")

    def numbers(text):
        return [float(value) for value in number.findall(text)]

    for found in compared.values():
        for said in (example.line(one, found[0]) for one in found):
            shown = [text for text in page if number.sub("", text).split() == number.sub("", said).split()]
            close = (np.allclose(numbers(text), numbers(said), rtol=0.02, atol=2e-3) for text in shown)
            assert any(close), f"docs/inference.md lacks what python examples/coast_down.py prints: {said}"
