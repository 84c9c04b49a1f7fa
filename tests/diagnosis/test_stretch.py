"""Which part of a long log is used, and that nothing of the rest is forgotten."""

from pathlib import Path

import numpy as np
import pytest

from cosim.diagnosis.pipeline.stretch import chosen_stretch, others, settled_error
from cosim.diagnosis.thresholds import LONGEST, SETTLING, SHORT_PIECE
from cosim.logs.log import Log

H = 0.01  # s: the choice depends on the time, not on the rate


def log_of(u: np.ndarray, start: float = 0.0) -> Log:
    """A log of a command alone."""
    return Log(
        time=start + np.arange(u.size) * H,
        source=Path("long"),
        warnings=(),
        synthetic=True,
        sha256="",
        signals={"u": u},
        units={"u": "1"},
        display={"u": "1"},
        held=frozenset(["u"]),
    )


def busy_between(low: float, high: float, duration: float) -> np.ndarray:
    """A command at rest but for one part, in which it visits its whole range."""
    time = np.arange(round(duration / H)) * H
    return np.where((time >= low) & (time < high), np.sin(0.7 * time), 0.0)


def test_a_short_log_is_used_whole() -> None:
    log = log_of(busy_between(10.0, 50.0, LONGEST))
    assert chosen_stretch(log) is log


@pytest.mark.parametrize("low", [0.0, 700.0, 1300.0])
def test_the_busy_part_is_chosen(low: float) -> None:
    log = log_of(busy_between(low, low + 250.0, 1600.0), start=50.0)
    part = chosen_stretch(log)
    assert part.duration == pytest.approx(LONGEST, abs=2 * H)
    assert part.time[0] <= 50.0 + low
    assert part.time[-1] >= 50.0 + low + 249.0


def test_a_part_that_visits_more_wins_over_one_that_moves_more() -> None:
    time = np.arange(round(1200.0 / H)) * H
    wild = 0.3 * np.sign(np.sin(9.0 * time)) * (time < 400.0)
    wide = np.sin(0.5 * time) * (time > 800.0)
    assert chosen_stretch(log_of(wild + wide)).time[0] > 700.0


def test_with_another_clock_the_first_part_is_taken() -> None:
    log = log_of(busy_between(900.0, 1100.0, 1200.0))
    assert chosen_stretch(log, from_start=True).time[0] == 0.0


def test_the_rest_and_the_stretch_are_the_whole_log() -> None:
    log = log_of(busy_between(700.0, 900.0, 1600.0))
    part = chosen_stretch(log)
    pieces = others(log, part)
    assert all(SHORT_PIECE < piece.duration <= LONGEST + H for piece in pieces)
    covered = sum(len(piece) for piece in pieces) + len(part)
    assert covered == pytest.approx(len(log), abs=2)


def test_error_counts_the_shape_and_not_offset_or_start() -> None:
    rng = np.random.default_rng(2)
    settling = round(SETTLING / H)
    offsets = np.repeat(rng.normal(size=40) * 50.0, 500)  # one a window
    drifted = np.concatenate([np.full(settling, 1e3), offsets + rng.normal(size=20_000)])
    assert settled_error(drifted, H, 500) == pytest.approx(1.0, rel=0.05)
