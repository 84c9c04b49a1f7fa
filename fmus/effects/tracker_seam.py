"""The tracker's two marker models disagree."""

from fmus.contract import Effect, Free, Variable

EFFECT = Effect(
    name="tracker.seam",
    text="Below 12 deg the tracker uses its first marker model, which disagrees with the second by a constant.",
    residual="a step between sensor and tracker at 12 deg",
    source="Table 3.4, fig. 5.16",
    key="seam",
    parameters={
        "seam": Variable(
            "rad",
            "Tracker reading below 12 deg minus the true angle",
            0.0,
            -1.0,
            1.0,
            display="deg",
            nominal=0.01,
            source="off: the models agree",
        )
    },
    free={"seam": Free(starts=(-0.01, 0.01), scale=0.01, floor=2e-4)},
)
