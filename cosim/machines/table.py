"""The table ``[machine]`` of a mapping file: a chain of our blocks, and what is known of it in the machine's own units.

[machine]
chain = ["dead_zone", "dcv", "continuity", "mechanical", "sensor"]
speed = "0.8 rad/s"                # at full command; "?" or left out: from the log
lag = "?"

[machine.parameters]
"dcv.w0" = "8 Hz"
"""

from collections.abc import Mapping as Values
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, field_validator, model_validator

from cosim.errors import UsageError
from cosim.logs import Mapping
from cosim.tables import checked
from cosim.units import parse_quantity, same_kind
from fmus import registry
from fmus.contract import Variable

TABLE = "machine"
UNKNOWN = "?"
MOVING = ("mechanical", "simplified")  # blocks that integrate to an angle or a position
# a block 'mechanical' with r = 1 m moves along a line: its SI units and those people read, the numbers being the same
# where nothing is measured between command and motion a torque is known as a part of that at full command only
FULL_COMMAND = "full command"
SCALE_FREE = {
    "N.m": FULL_COMMAND,
    "kg.m2": f"{FULL_COMMAND}.s2/{{0}}",
    "N.m.s/rad": f"{FULL_COMMAND}.s/{{0}}",
}
TRAVEL = {
    "kg.m2": "kg",
    "N.m.s/rad": "N.s/m",
    "N.m": "N",
    "rad": "m",
    "rad/s": "m/s",
    "rad/s2": "m/s2",
}
# what a valve or pump lets through, in the place of a speed: a resistance, an inertance and a pressure in those of the block
FLOW = {
    "kg.m2": "Pa.s2/m3",
    "N.m.s/rad": "Pa.s/m3",
    "N.m": "Pa",
    "rad": "m3",
    "rad/s": "m3/s",
    "rad/s2": "m3/s2",
}
# what a drive that closes a position loop of its own holds, in the place of a speed
PLACE = {
    "rad": "rad.s",
    "rad/s": "rad",
    "rad/s2": "rad/s",
}
# SI unit -> one that data sheets have
COMMON = {"rad/s": "deg/s", "rad": "deg", "m/s": "mm/s", "m": "mm", "m3/s": "l/min", "s": "ms", "Pa": "bar"}
# what a chain starts and ends with where the mapping's signals leave no choice
DRIVES, SHOWS = ("u", "torque", "force"), ("slew", "travel", "speed", "flow")
MOTION_OF = {
    "m": "travel",
    "m/s": "travel",
    "m3/s": "flow",
}  # unit of what the machine shows -> kind of motion
HERTZ = 6.283185307179586  # rad/s
Stated = dict[str, str | float]


class MachineTable(BaseModel):
    """What a mapping file says of a machine.

    Attributes:
        chain: our blocks in the order of the flow, from the command, or whatever is measured first, to the motion.
        input: signal that drives the first block.
        output: signal that the last block makes.
        motion: "turn" (angles), "travel" (a linear axis: kg, N, m) or "flow" (what a valve or pump lets through: Pa, m3).
        command: what it sets, a "speed" or a "place": of a drive that closes a position loop of its own the demanded place.
        drive: what moves it, "hydraulic" or "electric"; a motor has no oil, and a driver in place of the valve.
        speed: of the motion at a command of 1, such as ``0.8 rad/s``; ``?``: from the log.
        lag: time constant of that speed, such as ``70 ms``; ``?``: from the log.
        parameters: ``component.parameter`` -> quantity with its unit, a number in SI, or ``?``: from the log.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    chain: Annotated[tuple[str, ...], Field(min_length=1)]
    input: str = "u"
    output: str = "slew"
    motion: Literal["turn", "travel", "flow"] = "turn"
    command: Literal["speed", "place"] = "speed"
    drive: Literal["hydraulic", "electric"] = "hydraulic"
    speed: str | None = None
    lag: str | None = None
    parameters: Stated = {}

    @field_validator("chain")
    @classmethod
    def _blocks(cls, chain: tuple[str, ...]) -> tuple[str, ...]:
        known = [
            b
            for b in (*registry.BLOCKS, *registry.FMU_OF_COMPONENT)
            if b not in ("stimulus", "observer")
            if registry.COMPONENT_OF.get(b) is None  # fed back to: a wiring of its own says by what
        ]
        for name in chain:
            if name not in known:
                raise ValueError(f"no block '{name}'; {registry.suggestion(name, known)}")
        if len(set(chain)) < len(chain):
            raise ValueError("a block can stand in the chain once only")
        return chain

    @model_validator(mode="after")
    def _known(self) -> "MachineTable":
        for name, text in self.parameters.items():
            component, _, parameter = name.partition(".")
            variables = block_of(component).parameters if component in self.chain else {}
            if parameter not in variables:
                known = [f"{c}.{p}" for c in self.chain for p in block_of(c).parameters]
                raise ValueError(f"the chain has no '{name}'; {registry.suggestion(name, known)}")
            if text != UNKNOWN:
                self.value(name)
        if self.places and (self.chain[-1] != "mechanical" or self.motion == "flow" or self.forced):
            raise ValueError(
                "command = \"place\" is for a chain from a command to 'mechanical', its last block, that turns or travels"
            )
        self.motion_quantity("speed", "rad/s")
        self.motion_quantity("lag", "s")
        if (self.speed is not None or self.lag is not None) and not self.moves:
            raise ValueError(
                "speed and lag are those of a motion: the chain has neither mechanical nor simplified; of a chain that ends "
                "with a pressure, leave them out: the log tells its gain and its lag, unless 'parameters' states them "
                "('continuity.K_c', 'continuity.T')"
            )
        return self

    @property
    def moves(self) -> bool:
        """True if the chain ends in an angle or a position."""
        return any(block in MOVING for block in self.chain)

    @property
    def places(self) -> bool:
        """True if the drive holds the place it is told: what a speed is elsewhere is a place then."""
        return self.command == "place"

    @property
    def forced(self) -> bool:
        """True if a measured force or torque drives the mechanics directly."""
        return self.chain[0] == "mechanical" and not {"mechanical.A", "mechanical.r"} & set(self.parameters)

    @property
    def commanded(self) -> bool:
        """True if a command drives the chain, and no force or pressure."""
        return bool(block_of(self.chain[0]).commanded)

    @property
    def units(self) -> dict[str, str]:
        """SI unit -> the name people read for it on this machine."""
        if self.places:
            return (
                {**TRAVEL, "rad": "m.s", "rad/s": "m", "rad/s2": "m/s"}
                if self.motion == "travel"
                else dict(PLACE)
            )
        if self.motion == "travel":
            return {**TRAVEL, **({"Pa": "N"} if self.forced else {})}
        if self.motion == "flow":
            return dict(FLOW)
        return {"Pa": "N.m"} if self.forced else {}

    def variable(self, name: str) -> Variable:
        """Declaration of ``component.parameter``."""
        component, _, parameter = name.partition(".")
        return block_of(component).parameters[parameter]

    def unit(self, name: str) -> str:
        """Unit of ``component.parameter`` on this machine, SI."""
        variable = self.variable(name)
        return str(variable.unit if variable.frequency else self.units.get(variable.unit, variable.unit))

    def value(self, name: str) -> float | None:
        """A stated parameter, SI; None for one that the log must tell.

        Raises:
            ValueError: it is no quantity of the right dimension.
        """
        text = self.parameters[name]
        if text == UNKNOWN:
            return None
        return self.quantity(name, str(text), self.unit(name))

    def motion_quantity(self, name: str, unit: str) -> float | None:
        """Speed or lag, SI; None where the log must tell."""
        text = getattr(self, name)
        return (
            None if text is None or text == UNKNOWN else self.quantity(name, text, self.units.get(unit, unit))
        )

    def quantity(self, name: str, text: str, unit: str) -> float:
        """A text in a unit of the machine as a number in SI.

        Raises:
            ValueError: it is no quantity of the right dimension.
        """
        try:
            if unit == "rad/s" and text.strip().lower().endswith("hz"):
                return HERTZ * parse_quantity(text, "Hz")
            return parse_quantity(text, unit)
        except UsageError as error:
            raise ValueError(f"'{name}': {error}") from None


def without_unit(machine: MachineTable) -> list[str]:
    """What to say of quantities that a file states as bare numbers: they are taken in SI, whatever was meant."""
    stated: dict[str, tuple[str | float | None, str]] = {
        "speed": (machine.speed, machine.units.get("rad/s", "rad/s")),
        "lag": (machine.lag, "s"),
    }
    stated |= {n: (text, machine.unit(n)) for n, text in machine.parameters.items()}
    bare = [
        (name, f"{float(text):g}", unit)
        for name, (text, unit) in stated.items()
        if text not in (None, UNKNOWN) and unit not in ("", "1") and is_number(str(text))
    ]
    if not (bare := [item for item in bare if float(item[1]) != 0.0]):
        return []
    taken = ", ".join(f"{name} = {text} as {text} {unit}" for name, text, unit in bare)
    name, text, unit = bare[0]
    return [f'[machine]: a number without a unit is taken in SI: {taken}; write the unit, such as {name} = '
            f'"{text} {COMMON.get(unit, unit)}"']  # fmt: skip


def is_number(text: str) -> bool:
    """Whether a text is a number and nothing else."""
    try:
        float(text)
    except ValueError:
        return False
    return True


def block_of(component: str) -> Any:
    """The block that a component runs."""
    return registry.block(registry.FMU_OF_COMPONENT.get(component, component))


def machine_table(plain: Mapping, source: object) -> MachineTable:
    """The table [machine] of a mapping, checked. What it leaves out follows from the mapping's signals.

    Args:
        plain: the mapping.
        source: its file, for messages.

    Raises:
        DataError: a key or value is wrong; the message names it.
    """
    units = {name: own.unit for name, own in plain.signals.items()}
    return checked(
        MachineTable, {**following(plain.machine, units), **plain.machine}, TABLE, "a machine", source
    )


def following(content: dict[str, Any], signals: Values[str, str | None]) -> dict[str, str]:
    """What signals say of input, output and motion: the only one that can be meant, and a length or flow by its unit.

    Args:
        content: the table as read.
        signals: the mapping's signals and their units, where it states them.
    """
    found: dict[str, str] = {}
    for way, names in (("input", DRIVES), ("output", SHOWS)):
        there = [name for name in names if name in signals]
        if len(there) == 1:
            found[way] = there[0]
    unit = signals.get(str(content.get("output", found.get("output"))))
    for known, motion in MOTION_OF.items():
        if unit is not None and _of_kind(unit, known):
            found["motion"] = motion
    return found


def _of_kind(unit: str, known: str) -> bool:
    """Whether a unit measures what a known one does; an unreadable one is told where the log is read."""
    try:
        return same_kind(unit, known)
    except UsageError:
        return False
