"""The flow gain differs between the two directions."""

from fmus.contract import Effect, Free, Range, Variable, equation


@equation
def asymmetry_opening(opening, m, p):
    """Opening times 1 + a_q towards A, 1 - a_q towards B."""
    return opening * (1.0 + p.a_q) if opening > 0.0 else opening * (1.0 - p.a_q)


EFFECT = Effect(
    name="continuity.flow_asymmetry",
    text="The flow gain differs between the two directions.",
    residual="proportional to the magnitude of the load pressure, of one sign in both directions",
    source="Table 3.5: ports A and B differ as found",
    key="a_q",
    parameters={
        "a_q": Variable(
            "1",
            "Half the relative difference of the flow gains",
            0.0,
            -0.9,
            0.9,
            display="%",
            nominal=0.1,
            source="off: (4.33) is symmetric",
        )
    },
    free={"a_q": Free(starts=(-0.1, 0.1), scale=0.1, floor=0.003)},
    fills={"opening": asymmetry_opening},
    sole_form=True,
    ranges={"a_q": Range(-0.6, 0.6, "areas and edges of a pair of ports differ by a factor of four at most")},
    on={"continuity_physical": {}},
)
