"""The valve's dead zone is wider or narrower than the compensator assumes, each side its own."""

from fmus.contract import Effect, Free

EFFECT = Effect(
    name="dead_zone.mismatch",
    text="The valve's dead zone is wider or narrower than the compensator assumes, each side its own.",
    residual="the spool stands still, or jumps, at small commands; behind it a constant offset of the demand on each side",
    source="(2.2), Table 4.1; Table 3.5 shows the two sides differ",
    key="b_r",
    free={
        "b_r": Free(starts=(0.40, 0.50), scale=0.05, floor=0.004),
        "b_l": Free(starts=(-0.45, -0.35), scale=0.05, floor=0.004),
    },
    prior=1.0,  # every directional valve has an overlap, of several per cent of the command as a rule
    bends=True,
)
