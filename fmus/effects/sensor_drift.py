"""The slew sensor's zero drifts with time."""

from fmus.contract import Effect, Free, Variable, equation


@equation
def drift_remember(x, x1, u, m, p, c):
    """Time since the start."""
    return (m.drift_time + c.h,)


@equation
def drift_begin(x, u, p):
    """The clock starts with the log."""
    return (0.0,)


@equation
def drift_reading(slew, m, p):
    """Reading plus drift times time."""
    return slew + p.drift * m.drift_time


EFFECT = Effect(
    name="sensor.drift",
    text="The slew sensor's zero drifts in proportion to time.",
    residual="an angle error that grows with time, also at rest",
    source="warming of the potentiometer and its supply",
    key="drift",
    parameters={
        "drift": Variable(
            "rad/s",
            "Drift of the sensor's zero",
            0.0,
            -1.0,
            1.0,
            display="deg/s",
            nominal=1e-3,
            source="off: (3.2) has none",
        )
    },
    free={"drift": Free(starts=(-2e-4, 2e-4), scale=2e-4, floor=2e-6)},
    fills={"transmitted": drift_reading},
    memory={"drift_time": Variable("s", "Time since the start")},
    begin=drift_begin,
    remember=drift_remember,
    sole_form=True,
)
