"""The table ``[diagnose]`` of a mapping file: what the diagnosis must know of a machine that is not our crane.

[diagnose]
trusted = ["mechanical.J", "mechanical.b"]
consider = ["mechanical.constant_load"]

[diagnose.scale]
"N.m" = 0.1
"""

from typing import Annotated, Any, Self

from pydantic import BaseModel, ConfigDict, Field, field_validator, model_validator

from cosim.diagnosis.thresholds import READ_AT_START
from cosim.errors import UsageError
from cosim.tables import checked
from cosim.units import parse_quantity
from fmus import registry

Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
TABLE = "diagnose"


class Options(BaseModel):
    """What a mapping says of a machine.

    Attributes:
        trusted: parameters that are trusted to the tolerance only, and freed by ``--calibrate``; by default those of our
            models that the machine has.
        free: parameters of which nothing is known: they are fitted to every log, as with ``--calibrate``. A cause named on
            top of a guess would only make up for it. With these there are no trusted ones.
        consider: effects that are candidates on request only, and are requested.
        exclude: effects that this machine cannot have.
        absolute: places of which a constant error counts; elsewhere each window has an offset of its own.
        drifting: speeds whose zero wanders, as that of a gyroscope does: each window has an offset of its own.
        held: places that a drive holds as it is told; the model's speed stands for them.
        scale: SI unit, or ``component.parameter`` for one of this unit -> how much smaller or larger than on the crane a
            typical change is, where searches begin.
        step: longest step of the simulation, s.
        rest: time at the start over which the first value of a signal is averaged, s; short where a log begins in motion.
        sample: what one sample counts as, s, where the sampling interval is not known.
        held_out_from: the log from this time on (samples, for a log in samples) is not fitted but held out.
        causes: causes looked for in one group at most.
        units: SI unit -> name people read for it, such as "kg" for "kg.m2" on a linear axis; see `Lexicon.units`.
        blocks: block -> what people call it on this machine.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    trusted: tuple[str, ...] | None = None
    free: tuple[str, ...] = ()
    consider: tuple[str, ...] = ()
    exclude: tuple[str, ...] = ()
    absolute: tuple[str, ...] = ()
    drifting: tuple[str, ...] = ()
    held: tuple[str, ...] = ()
    scale: dict[str, Positive] = {}
    step: float | None = None
    sample: float | None = None
    rest: float = READ_AT_START
    held_out_from: Positive | None = None
    causes: Annotated[int, Field(ge=1, le=8)] = 3
    units: dict[str, str] = {}
    blocks: dict[str, str] = {}

    @field_validator("held_out_from", mode="before")
    @classmethod
    def _from(cls, value: object) -> object:
        return cls._time(value) if isinstance(value, str) else value

    @field_validator("step", "sample", "rest", mode="before")
    @classmethod
    def _time(cls, value: object) -> float:
        if not isinstance(value, str):
            raise ValueError('write a time with its unit, such as "1 ms"')
        try:
            found = parse_quantity(value, "s")
        except UsageError as error:
            raise ValueError(str(error)) from None
        if not found > 0.0:
            raise ValueError("a time must be positive")
        return found

    @model_validator(mode="after")
    def _one_of_two(self) -> Self:
        if self.free and self.trusted:
            raise ValueError(
                "give 'trusted' or 'free', not both: where one parameter is free, all that are named are"
            )
        return self

    @property
    def named(self) -> tuple[str, ...] | None:
        """Parameters that may be fitted; None where the mapping names none."""
        return self.free or self.trusted

    @field_validator("consider", "exclude")
    @classmethod
    def _effects(cls, names: tuple[str, ...]) -> tuple[str, ...]:
        known = list(registry.effects())
        for name in names:
            if name not in known:
                raise ValueError(f"no effect '{name}'; {registry.suggestion(name, known)}")
        return names


def options_of(content: dict[str, Any], source: object) -> Options:
    """The table, checked.

    Args:
        content: the table as read.
        source: the mapping file, for messages.

    Raises:
        DataError: a key or value is wrong; the message names it.
    """
    return checked(Options, content, TABLE, "a mapping", source)
