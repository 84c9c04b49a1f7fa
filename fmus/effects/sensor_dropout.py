"""Stale samples of the slew sensor, from lost packets."""

from fmus.contract import Effect, Free, Variable, equation


@equation
def dropout_remember(x, x1, u, m, p, c):
    """Next number of the minimal standard generator, exact in doubles, and the reading that a lost packet would repeat."""
    return (16807.0 * m.dropout_seed) % 2147483647.0, x1.slew


@equation
def dropout_begin(x, u, p):
    """A fixed seed: the same run twice gives the same samples."""
    return 20190515.0, x.slew


@equation
def dropout_reading(slew, m, p):
    """The last reading once more, with probability p_drop."""
    return m.dropout_held if m.dropout_seed < 2147483647.0 * p.p_drop else slew


EFFECT = Effect(
    name="sensor.dropout",
    text="Samples of the slew sensor are stale: lost packets repeat the last one.",
    residual="exactly repeated samples while the slew moves",
    source="UDP link (SYSTEM section 1); generator: Park and Miller, Comm. ACM 31(10), 1988",
    key="p_drop",
    parameters={
        "p_drop": Variable(
            "1",
            "Probability that a sample is stale",
            0.0,
            0.0,
            0.99,
            display="%",
            nominal=0.1,
            source="off: no lost packets",
        )
    },
    free={"p_drop": Free(starts=(0.1,), scale=0.1, floor=0.001)},
    fills={"transmitted": dropout_reading},
    memory={
        "dropout_seed": Variable("1", "State of the generator"),
        "dropout_held": Variable("rad", "Reading that a lost packet repeats", display="deg"),
    },
    begin=dropout_begin,
    remember=dropout_remember,
    when="after",
)
