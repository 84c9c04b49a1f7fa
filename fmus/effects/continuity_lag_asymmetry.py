"""The load pressure falls with another time constant than it rises with."""

from fmus.contract import Effect, Free, Range, Variable, equation


@equation
def own_time_constant(T, p):
    """T of a load pressure that rises, r_T times that of one that falls."""
    return T * p.r_T


EFFECT = Effect(
    name="continuity.lag_asymmetry",
    text="The load pressure falls with another time constant than it rises with.",
    residual="pressure error during transients of one direction only, in phase with the pressure's rate",
    source="(4.26) with another way in than out: a pump fills a vessel, a leak empties it",
    key="r_T",
    parameters={
        "r_T": Variable(
            "1",
            "Time constant of a falling load pressure, over that of a rising one",
            1.0,
            0.01,
            100.0,
            source="off: one T, (4.33)",
        )
    },
    free={"r_T": Free(starts=(0.5, 2.0), scale=0.3, floor=0.01)},
    ends=True,
    fills={"falling_time_constant": own_time_constant},
    ranges={"r_T": Range(0.03, 30.0, "beyond it one of the two is no lag that a log shows beside the other")},
)
