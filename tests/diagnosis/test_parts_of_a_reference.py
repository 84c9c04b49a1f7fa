"""How finely held-out data are cut and sampled beside a linear reference."""

import numpy as np

from cosim.diagnosis.fitting.chain import window_of
from cosim.diagnosis.residuals.reference import enough_parts, finer, quickest
from cosim.diagnosis.thresholds import REFERENCE_PARTS, REFERENCE_WINDOWS


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


def test_a_log_sampled_slowly_has_windows_of_many_samples() -> None:
    assert window_of([1024], 1, 4.0) >= 40, "5 s would be one sample"
    assert window_of([60000], 10, 1e-3) == 500, "5 s of bins of 10 ms"
