"""The slew sensor's reading comes in steps."""

import math

from fmus.contract import Effect, Free, Variable, equation


@equation
def quantised_reading(slew, m, p):
    """Rounded to a multiple of the quantum."""
    return p.quantum * math.floor(slew / p.quantum + 0.5)


EFFECT = Effect(
    name="sensor.quantisation",
    text="The slew sensor's reading comes in steps.",
    residual="the measured slew takes few distinct values; a saw-tooth error of the step's size",
    source="resolution of the analogue-to-digital conversion",
    key="quantum",
    parameters={
        "quantum": Variable(
            "rad",
            "Step of the reading",
            0.0,
            0.0,
            1.0,
            display="deg",
            nominal=1e-3,
            source="off: continuous reading (3.2)",
        )
    },
    free={"quantum": Free(starts=(0.002,), scale=0.002, floor=1e-5)},
    fills={"transmitted": quantised_reading},
)
