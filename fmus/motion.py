"""Motion of an inertia under viscous friction and a torque on a straight line, exact, and the ends of its travel."""

from fmus.contract import equation
from fmus.linear import phi_functions


@equation
def slide(
    theta: float, omega: float, t0: float, t1: float, h: float, J: float, b: float
) -> tuple[float, float]:
    """Angle and velocity after h under a torque on a straight line from t0 to t1 and viscous friction, exact."""
    decay, phi1, phi2, phi3 = phi_functions(b * h / J)
    return slid(theta, omega, t0, t1, h, J, decay, phi1, phi2, phi3)


@equation
def slid(theta: float, omega: float, t0: float, t1: float, h: float, J: float, decay: float, phi1: float, phi2: float, phi3: float) -> tuple[float, float]:  # fmt: skip
    """The same with the functions of b h/J at hand."""
    return (
        theta + h * (phi1 * omega + h / J * (phi2 * t0 + phi3 * (t1 - t0))),
        decay * omega + h / J * (phi1 * t0 + phi2 * (t1 - t0)),
    )


@equation
def stopping_time(
    omega: float, direction: float, t0: float, slope: float, h: float, J: float, b: float
) -> float:
    """Time within h at which a motion in `direction` comes to rest (it has turned by h): Newton's steps, bracketed."""
    low, high = 0.0, h
    t = 0.5 * h
    for _ in range(60):
        _, w = slide(0.0, omega, t0, t0 + slope * t, t, J, b)
        if w * direction > 0.0:
            low = t
        else:
            high = t
        change = h
        rate = (t0 + slope * t - b * w) / J
        if rate * direction < 0.0:
            change = w / rate
        t = t - change
        if abs(change) <= 1e-9 * h:
            break  # quadratic convergence: the error is now far below rounding
        if t <= low or t >= high:
            t = 0.5 * (low + high)
    return t


@equation
def stopped(theta: float, omega: float, low: float, high: float) -> tuple[float, float]:
    """Angle and velocity between the ends of the travel: an end takes the speed into it, without rebound."""
    if theta >= high:
        return high, min(omega, 0.0)
    if theta <= low:
        return low, max(omega, 0.0)
    return theta, omega
