"""Units and words in which a diagnosis is told to people; a machine of another kind has its own."""

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field

from cosim.signals import SIGNALS
from cosim.units import factor
from fmus.contract import Variable

ELECTRIC_DRIVER = "driver"  # what the block in place of a motor's valve is called


@dataclass(frozen=True)
class Shown:
    """How a signal is shown.

    Attributes:
        unit: what people read.
        scale: shown value per value inside the diagnosis (the model's variable, SI).
        text: what it is.
    """

    unit: str
    scale: float
    text: str


@dataclass(frozen=True)
class Lexicon:
    """Words of one machine; the empty one is the crane's.

    Attributes:
        signals: signal -> how it is shown, where that is not as on the crane.
        units: SI unit -> name that people read for it, the numbers being the same; "1000 full command": it is so many.
        blocks: block -> what it is called.
        time: what the unit of time is called, where it is not the second, and how many of it make one second.
    """

    signals: dict[str, Shown] = field(default_factory=dict)
    units: dict[str, str] = field(default_factory=dict)
    blocks: dict[str, str] = field(default_factory=dict)

    @property
    def electric(self) -> bool:
        """Whether a motor moves it, of which nobody says valve or spool."""
        return self.blocks.get("dcv") == ELECTRIC_DRIVER

    @property
    def holds(self) -> bool:
        """Whether a place stands for the model's speed: a drive that holds the place it is told."""
        return self.units.get("rad/s") in ("rad", "m")

    def signal(self, name: str) -> tuple[str, float]:
        """Display unit of a signal and the factor from SI to it."""
        if name in self.signals:
            return self.signals[name].unit, self.signals[name].scale
        unit = SIGNALS[name].unit if name in SIGNALS else "1"
        source = SIGNALS[name].si if name in SIGNALS else "1"
        return unit, factor(source, unit)

    def quantity(self, si: str, display: str | None = None) -> tuple[str, float]:
        """Unit in which a quantity is shown and the factor from SI to it."""
        if si in self.units:
            return named(self.units[si])
        unit = display or si
        return unit, factor(si, unit)

    def to_si(self, unit: str, si: str) -> float:
        """Factor from a unit that this lexicon shows for `si` to it."""
        own, count = named(self.units.get(si, ""))
        return 1.0 / count if own == unit and own else factor(unit, si)

    def parameter(self, variable: Variable) -> tuple[str, float]:
        """Unit in which a parameter is shown and the factor from SI to it."""
        if variable.frequency:
            return variable.unit, 1.0
        return self.quantity(variable.unit, variable.display)


def named(text: str) -> tuple[str, float]:
    """A unit of a lexicon: its name, and how many of it make one SI unit."""
    count, _, name = text.partition(" ")
    try:
        return name, float(count)
    except ValueError:
        return text, 1.0


CRANE = Lexicon()
_CURRENT: ContextVar[Lexicon] = ContextVar("lexicon", default=CRANE)


def current() -> Lexicon:
    """The words in use."""
    return _CURRENT.get()


@contextmanager
def speaking(lexicon: Lexicon) -> Iterator[None]:
    """Within this context answers and reports use these words."""
    token = _CURRENT.set(lexicon)
    try:
        yield
    finally:
        _CURRENT.reset(token)
