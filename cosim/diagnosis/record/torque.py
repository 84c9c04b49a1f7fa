"""How fast a torque may change that is seen along a measured motion."""

TORQUE_CUTOFF = 5.0  # Hz: an angle noise of 0.01 deg at 1 kHz then leaves some 10 N m of torque noise
# of the cutoff that a log is long at least: one move of a servo in 0.7 s is no slew of a minute
PERIODS = 20.0


def cutoff_for(span: float) -> float:
    """Cutoff of a torque along the motion of a log of this length, s, in Hz."""
    return max(TORQUE_CUTOFF, PERIODS / span)
