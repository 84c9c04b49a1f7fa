"""A torque that is always there, in one direction."""

from fmus.contract import Effect, Free, Range

EFFECT = Effect(
    name="mechanical.constant_load",
    text="A constant torque pulls in one direction: weight on an inclined axis, a spring, or an offset of the drive.",
    residual="a missing torque that is the same at every speed and angle; the drive creeps or needs effort to rest",
    source="(4.27): tau_load; EMPS: the offset of A. Janot, M. Gautier, M. Brunot, Data Set and Reference Models of EMPS, 2019",
    key="tau_load",
    free={"tau_load": Free(starts=(-100.0, 100.0), scale=100.0, floor=3.0)},
    sole_form=True,
    prior=-1.0,  # where viscous friction alone holds the drive, a drift of the sensor looks the same and is met more often
    ranges={
        "tau_load": Range(
            -5.0,
            5.0,
            "a drive holds its load: beyond a few times its greatest torque it would be carried off",
            of="torque",
        )
    },
)
