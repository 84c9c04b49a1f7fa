"""The tracker's clock has its own zero and rate."""

from fmus.contract import Effect, Free, Range, Variable

EFFECT = Effect(
    name="tracker.clock",
    text="The tracker's clock is offset and runs at another rate: its stamp for the instant t is (t - offset)/rate.",
    residual="difference between sensor and tracker in proportion to the velocity, growing with time if the rate differs",
    source="the tracker runs offline on its own clock (SYSTEM section 1)",
    key="offset",
    parameters={
        "offset": Variable(
            "s", "Instant at which the tracker's clock reads zero", 0.0, -1e5, 1e5, source="off: synchronised"
        ),
        "rate": Variable(
            "1",
            "Seconds of the log per second of the tracker's clock",
            1.0,
            0.5,
            2.0,
            source="off: same rate",
        ),
    },
    free={
        "offset": Free(starts=(-0.5, 0.0, 0.5), scale=0.2, floor=0.001),
        "rate": Free(starts=(1.0,), scale=1e-4),
    },
    ranges={
        "rate": Range(
            0.9,
            1.1,
            "clocks agree to parts in ten thousand, frame rates to a few per cent; beyond it is another unit",
        )
    },
)
