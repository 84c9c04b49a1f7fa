"""Fits the simplified drive to one log of the mini excavator's swing axis; `mini_excavator.ssv` holds the result.

    python examples/models/fit_mini_excavator.py LOG [LOG ...]

The first log is fitted, the others are only scored. There is no compensator on this machine. The angle integrates
everything that the model lacks, so the fit is made in windows of 5 s, each with a free offset; the error over the whole
log is printed beside it. Each evaluation is a run of the FMUs over the whole log.
"""

import sys
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from cosim.compare import Comparator, load_mapping, open_model, rms
from cosim.compare.metrics import without_offsets
from cosim.logs import load_log

HERE = Path(__file__).resolve().parent
STEP = 0.02  # s; the logs are sampled irregularly, about every 53 ms
OFF = {"compensator.d_plus": 0.0, "compensator.d_minus": 0.0}
# name: (start, lowest, highest); break points and slope in fractions of full command, then gain and pole
FREE = {
    "dead_zone.b_r": (0.15, 0.0, 0.9),
    "dead_zone.b_l": (-0.15, -0.9, 0.0),
    "dead_zone.m_l": (1.0, 0.1, 10.0),
    "simplified.k": (6.0, 0.01, 500.0),
    "simplified.a": (5.0, 0.2, 100.0),
}
SCALE = (0.1, 0.1, 0.3, 3.0, 3.0)


def comparator(log: Path) -> Comparator:
    """A log of the machine beside the simplified drive."""
    mapping, table = load_mapping(HERE / "mini_excavator.toml")
    return Comparator(load_log(log, mapping), open_model("simplified"), table=table, step=STEP)


def errors(bench: Comparator, values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Measured minus simulated slew angle (n,) [rad] for parameter values in the order of FREE."""
    named = dict(zip(FREE, map(float, values), strict=True))
    return np.asarray(bench.log["slew"] - bench.simulate({**OFF, **named})["slew"])


def main() -> None:
    """Fit the first log, score all of them."""
    logs = [Path(name) for name in sys.argv[1:]]
    if not logs:
        sys.exit(__doc__)
    start, low, high = zip(*FREE.values(), strict=True)
    with comparator(logs[0]) as bench:
        best = least_squares(
            lambda values: without_offsets(errors(bench, values), bench.time),
            start,
            bounds=(low, high),
            x_scale=SCALE,
            diff_step=1e-3,
        ).x
    for name, value in zip(FREE, best, strict=True):
        print(f"{name} = {value:.4g}")
    for log in logs:
        with comparator(log) as bench:
            error = errors(bench, best)
            parts = without_offsets(error, bench.time)
        whole, windows = np.degrees([rms(error), rms(parts)])
        print(f"{log.name}: RMSE {whole:.3g} deg, in windows {windows:.3g} deg")


if __name__ == "__main__":
    main()
