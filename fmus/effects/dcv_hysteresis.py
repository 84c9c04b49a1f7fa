"""Play on the compensated command, before the valve's dead zone."""

from fmus.contract import Effect, Free, Variable, equation


@equation
def hysteresis_remember(x, x1, u, m, p, c):
    """The play's output follows the command once it has moved by the half-width."""
    return (max(u.command - p.play, min(u.command + p.play, m.play_position)),)


@equation
def hysteresis_begin(x, u, p):
    """In the middle."""
    return (0.0,)


@equation
def hysteresis_command(command, m, p):
    """The play's output."""
    return m.play_position


EFFECT = Effect(
    name="dcv.hysteresis",
    text="The valve answers a reversed command only after it has moved by twice the half-width.",
    residual="spool error of one sign while the command rises and of the other while it falls; a loop of spool over command",
    source="PVES data: hysteresis 0-2 % (SYSTEM section 1); play operator: Visintin, Differential Models of Hysteresis, 1994",
    acts_on="dead_zone",
    key="play",
    parameters={
        "play": Variable(
            "1",
            "Half-width of the play on the command",
            0.0,
            0.0,
            1.0,
            display="%",
            nominal=0.01,
            source="off: no play in (4.16)",
        )
    },
    free={"play": Free(starts=(0.01, 0.04), scale=0.02, floor=0.002)},
    fills={"incoming_command": hysteresis_command},
    memory={"play_position": Variable("1", "Output of the play")},
    begin=hysteresis_begin,
    remember=hysteresis_remember,
)
