"""How finely held-out data are cut and sampled beside a linear reference."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.signal import lfilter

from cosim.compare.metrics import rms
from cosim.diagnosis.fitting.chain import window_of
from cosim.diagnosis.record.record import Record, joined
from cosim.diagnosis.residuals import reference as module
from cosim.diagnosis.residuals.freeform import Leftover
from cosim.diagnosis.residuals.reference import (
    Reference,
    across,
    enough_parts,
    finer,
    fitted_to,
    in_turn,
    of_whole,
    quickest,
    with_gains_of,
)
from cosim.diagnosis.thresholds import REFERENCE_PARTS, REFERENCE_WINDOWS
from cosim.diagnosis.verdict import FREE_CURVE
from cosim.diagnosis.verdict.verdict import missing_curve
from cosim.inference.linear import Data, LinearModel, Sections, model_of
from cosim.system.effects import play


def test_few_windows_of_a_swinging_error_are_cut() -> None:
    t = np.arange(1000) * 0.01
    window = np.repeat([0, 1, 2], 330)
    window = np.append(window, np.full(10, -1))
    swinging = np.sin(80.0 * t)
    parts = finer(window, (swinging, 0.5 * swinging))
    assert parts.max() + 1 == REFERENCE_PARTS >= REFERENCE_WINDOWS
    assert np.all(parts[-10:] == -1)
    for k in range(3):  # no part reaches from one window into the next
        assert set(parts[window == k]) == set(range(4 * k, 4 * k + 4))


def test_an_error_that_drifts_is_left_in_its_windows() -> None:
    t = np.linspace(0.0, 1.0, 900)
    window = np.repeat([0, 1, 2], 300)
    assert enough_parts(t, np.sin(300.0 * t)) == 0
    assert np.array_equal(finer(window, (t, np.sin(300.0 * t))), window)


def test_points_lie_as_fine_as_a_signal_needs() -> None:
    h = 1.0 / 610.0
    t = np.arange(6000) * h
    assert quickest(np.sin(2.0 * np.pi * 72.0 * t), t, h) == 1
    assert quickest(np.sin(2.0 * np.pi * 1.0 * t), t, h) > 10


@pytest.mark.parametrize("pole", [0.5012, 0.5, 0.4, 1.0])
def test_a_pole_that_coarse_data_just_tell_from_an_integrator_is_predicted_on_fine_ones(pole: float) -> None:
    """2 s of coarse samples are 1.99 s of fine ones: the reference of a whole log failed."""
    models = []
    for h, count in ((0.02, 100), (0.01, 199)):
        t = h * np.arange(count)
        u = (t > 0.3) * 1.0
        data = Data(
            u, 1.0 + np.convolve(u, np.exp(-pole * t))[:count] * h, h, lambda rows: rows, np.arange(count) % 5
        )
        models.append((data, model_of(data, Sections((pole,)), data.y)))
    (_, coarse), (fine, own) = models
    model = with_gains_of(coarse, fine)
    assert np.array_equal(model.predicted(fine.u, fine.h), own.predicted(fine.u, fine.h))


def test_a_log_sampled_slowly_has_windows_of_many_samples() -> None:
    assert window_of([1024], 1, 4.0) >= 40, "5 s would be one sample"
    assert window_of([60000], 10, 1e-3) == 500, "5 s of bins of 10 ms"
    assert window_of([1099, 1099, 602], 2, 5e-3) == 301, "the shortest log has a window, too"


def lagging(seed: int, gain: float, count: int = 2000, h: float = 0.02) -> Record:
    """A log of a first-order lag of a second, with white noise of 0.01."""
    rng = np.random.default_rng(seed)
    command = np.repeat(rng.uniform(-1.0, 1.0, count // 50), 50)
    kept = np.exp(-h)
    slew = lfilter([0.0, gain * (1.0 - kept)], [1.0, -kept], command) + 0.01 * rng.standard_normal(count)
    return Record(h, {"u": command, "slew": slew})


def test_a_log_is_fitted_once_for_a_block_and_for_the_whole(monkeypatch: pytest.MonkeyPatch) -> None:
    log, known = lagging(0, 1.0, 400), {}
    first = fitted_to(log, "u", "slew", known)
    monkeypatch.setattr(module, "reference", lambda data: pytest.fail("fitted anew"))
    after = {"slew": np.zeros(400)}
    assert across(log, lagging(1, 1.0, 400), 0, "u", ["slew"], after, 40, (), known)["slew"].model is first


def test_of_several_logs_the_reference_predicts_each_from_the_others() -> None:
    logs = [lagging(k, gain) for k, gain in enumerate((1.0, 1.0, 1.5))]
    record = joined(logs)
    y = record.signals["slew"]
    found = in_turn(record, "u", ["slew"], {"slew": 0.1 * y}, 200)["slew"]
    first, second, odd = np.sqrt(found.squares.reshape(3, -1).mean(axis=1))
    # the other two have gains of 1 and 1.5; the odd one is predicted by two of 1
    moved = [float(np.std(log.signals["slew"])) for log in logs]
    assert odd == pytest.approx(moved[2] / 3.0, rel=0.1)
    assert first == pytest.approx(0.25 * moved[0], rel=0.3)
    assert second == pytest.approx(0.25 * moved[1], rel=0.3)
    assert found.ours_error == pytest.approx(0.1 * float(np.sqrt(np.mean(y**2))), rel=1e-3)
    assert found.model.order == 1


def test_a_linear_model_is_a_bar_as_high_as_one_of_fewer_poles_sets_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A sensor of light in three levels: order 5, "a linear model leaves 570" of a range of 88; a constant gain left 12."""

    def wild(data: Data) -> LinearModel:
        models = [
            model_of(data, s, data.rows(data.y[None])[0]) for s in (Sections((1.0,)), Sections((1.0, 0.1)))
        ]
        return replace(models[1], gains=models[1].gains + 3.0, lower=(models[0],))

    monkeypatch.setattr(module, "reference", wild)
    log, other = lagging(0, 1.0), lagging(1, 1.0)
    after = {"slew": np.zeros(2000)}
    whole = of_whole(log, "u", ["slew"], after, 200, {})
    beside = across(log, other, 0, "u", ["slew"], after, 200, (), {})
    turns = in_turn(joined([log, other]), "u", ["slew"], {"slew": np.zeros(4000)}, 200)
    for found in (whole["slew"], beside["slew"], turns["slew"]):
        assert found.model.order == 1
        assert found.error < 0.02
        assert found.evidence.error > 1.0


@pytest.mark.parametrize(
    ("linear", "unseen", "ahead"), [(0.49, None, True), (0.9999, None, False), (0.49, 0.9999, False)]
)
def test_a_model_is_behind_what_was_chosen_unseen_and_by_what_counts(linear, unseen, ahead) -> None:
    """A servo drive's 0.3393 against 0.3394 rad/s was surely better, and "linear dynamics are missing"."""
    ours = np.linspace(1.0, 1.1, 12)
    known = None if unseen is None else unseen * ours
    assert Reference(SimpleNamespace(), linear * ours, ours, unseen=known).ahead == ahead


def test_gains_that_cancel_between_quick_poles_are_those_of_the_log_s_own_samples(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A speed loop, 2 ms late: most of a step in 3 ms, the rest in 80 ms. Points of 4 ms do not tell quick poles apart."""
    h, rng = 1e-3, np.random.default_rng(3)
    command = np.repeat(rng.uniform(-50.0, 50.0, 25), 400)

    def lag(T: float) -> np.ndarray:
        kept = np.exp(-h / T)
        return lfilter([0.0, 0.0, 0.0, 1.0 - kept], [1.0, -kept], command)

    speed = 0.85 * lag(3e-3) + 0.15 * lag(0.08) + 0.05 * rng.standard_normal(command.size)
    coarse: list[LinearModel] = []

    def found(data: Data) -> LinearModel:
        poles = Sections((12.5, 1300.0, 3000.0), delay=1.7e-3)
        coarse.append(model_of(data, poles, data.rows(data.y[None])[0]))
        return coarse[-1]

    monkeypatch.setattr(module, "reference", found)
    model = fitted_to(Record(h, {"u": command, "slew": speed}), "u", "slew", {})
    left, of_points = (rms(speed - m.simulate(command, speed, h)) for m in (model, coarse[0]))
    assert model.sections == coarse[0].sections
    assert left < 0.2 * of_points


def bent(u: np.ndarray, y: np.ndarray, h: float) -> tuple[SimpleNamespace, SimpleNamespace]:
    """A task and a record of one signal that a command drives, in windows of 5 s."""
    numbers = np.arange(u.size) // round(5.0 / h)
    rule = SimpleNamespace(demean=False, layout=SimpleNamespace(numbers=lambda count: numbers[:count]))
    group = SimpleNamespace(drive="u")
    model = SimpleNamespace(group=group, drive=u, h=h, cuts=())
    return SimpleNamespace(model=model, measured={"flow": y}, rules={"flow": rule}), SimpleNamespace(
        time=h * np.arange(u.size)
    )


def test_a_bent_curve_with_play_is_no_dynamics_and_a_lag_is() -> None:
    """A servo valve's flow over one slow ramp up and down: "linear dynamics are missing: an integrator, an integrator"."""
    h = 0.1
    t = h * np.arange(3000)
    ramp = np.interp(t, [0.0, 150.0, 300.0], [-1.0, 1.0, -1.0])
    followed = play(ramp, h, {"half_width": 0.02})
    assert module.of_curve(*bent(ramp, np.tanh(1.5 * followed), h)) < 0.01
    steps = np.repeat(np.random.default_rng(4).uniform(-1.0, 1.0, 60), 50)
    lagged = lfilter([h / 3.0], [1.0, h / 3.0 - 1.0], steps)
    assert module.of_curve(*bent(steps, lagged, h)) > 0.1


def test_held_out_data_judge_the_curve_that_the_log_has() -> None:
    h = 0.1
    t = h * np.arange(3000)
    ramp = np.interp(t, [0.0, 150.0, 300.0], [-1.0, 1.0, -1.0])
    task, record = bent(ramp, np.abs(ramp), h)
    for factor, error in ((1.0, 0.0), (2.0, 0.5)):
        held = SimpleNamespace(signals={"u": ramp, "flow": factor * np.abs(ramp)}, cuts=())
        assert module.of_curve(task, record, held, 100) == pytest.approx(error, abs=0.1)


def test_what_a_curve_tells_is_said_as_such() -> None:
    finding = SimpleNamespace(
        task=bent(np.zeros(1), np.zeros(1), 0.1)[0],
        before={"flow": Leftover(0.0, 1.0, 1.0, np.zeros(1), {}, {}, 1.0)},
        reference=SimpleNamespace(ours_error=1.0),
        lacks_curve=0.6,
    )
    finding.task.model.group.name = "dcv"
    rest = missing_curve(finding)
    assert rest.what.startswith(f"flow follows u {FREE_CURVE}")
    assert "leaves 60% of the error" in rest.what
    assert rest.leftover.rms == pytest.approx(0.8)
