"""The full-order chain of real FMUs against the exact solution of (5.12), with the command held over each step."""

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.signal import cont2discrete

from cosim.master import Runner
from cosim.paths import ssp_folder
from cosim.ssp.write import write_ssp

STOP = 20.0  # s, three periods of 1 rad/s
LIMIT = 1e-5  # deg, the accuracy asked of the runner at 1 ms

# SYSTEM sections 4 to 6: DCV (5.3), continuity (5.4), mechanics with the pole of (5.12)
K, W0, ZETA, K_C, T, J, AREA, R = 2.375e-3, 25.23, 0.545, 5.28e8, 0.11, 763.9437268410978, 8.4193e-3, 0.1
B = 34.9 * J


def exact(u: NDArray[np.float64], h: float) -> NDArray[np.float64]:
    """Slew angle, rad, of the linear chain for a command held over steps of h, s."""
    a = np.zeros((5, 5))
    a[0, 1] = 1.0
    a[1, :2] = [-W0 * W0, -2.0 * ZETA * W0]
    a[2, 0], a[2, 2] = K_C / T, -1.0 / T
    a[3, 4] = 1.0
    a[4, 2], a[4, 4] = AREA * R / J, -B / J
    b = np.array([[0.0], [K * W0 * W0], [0.0], [0.0], [0.0]])
    f, g, *_ = cont2discrete((a, b, np.eye(5), np.zeros((5, 1))), h)
    x, theta = np.zeros(5), np.zeros(u.size)
    for k in range(u.size - 1):
        x = f @ x + g[:, 0] * u[k]
        theta[k + 1] = x[3]
    return theta


@pytest.fixture(scope="module")
def errors(tmp_path_factory: pytest.TempPathFactory) -> dict[float, float]:
    """Step, s -> largest error of the slew angle, deg, for a sine of 1 rad/s."""
    package = write_ssp(
        ssp_folder() / "full_order.ssd", tmp_path_factory.mktemp("full") / "open.ssp", open=True
    )
    found = {}
    with Runner(Path(package)) as runner:
        for h in (1e-3, 2e-3, 4e-3):
            time = np.arange(round(STOP / h) + 1) * h
            u = np.sin(time)
            # straight into the valve: compensator and dead zone cancel only away from zero (4.9)
            result = runner.run(
                STOP, h, inputs={"dcv.demand": (time, u)}, hold=("dcv.demand",), record=["mechanical.theta"]
            )
            found[h] = float(np.degrees(np.abs(result["mechanical.theta"] - exact(u, h)).max()))
    return found


def test_angle_is_within_the_limit_at_one_millisecond(errors: dict[float, float]) -> None:
    assert 0.0 < errors[1e-3] < LIMIT


def test_coupling_error_falls_with_the_square_of_the_step(errors: dict[float, float]) -> None:
    for h in (2e-3, 4e-3):
        assert errors[h] / errors[h / 2.0] == pytest.approx(4.0, rel=0.1)
