"""What is known beside a log: the numbers of the crane, or those of the machine that its mapping describes.

A machine has what its file says. A compensator that it does not have adds nothing, a valve's dead zone that nobody states is
none. Only the crane's own numbers go into the crane's models.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from cosim import console
from cosim.identify.nominal import nominal
from cosim.lexicon import CRANE, Lexicon
from cosim.logs import Log
from cosim.units import is_speed

OURS = ("simplified", "full_order", "physical")  # models of the crane
PLACES = ("rad", "m")  # SI units of an angle and a position
ABSENT = {  # what a component that a machine does not have does: nothing
    "compensator": {"d_plus": 0.0, "d_minus": 0.0},
    "dead_zone": {"b_r": 0.0, "b_l": 0.0, "m_r": 1.0, "m_l": 1.0, "limit": float(np.inf)},
}


@dataclass(frozen=True)
class Other:
    """A machine that is not the crane.

    Attributes:
        name: of its model.
        mapping: the file that describes it.
        blocks: its components, as far as they are ours.
        numbers: ``component.parameter`` -> SI.
        command, motion: the signals at its two ends.
        lexicon: its words and units.
    """

    name: str
    mapping: Path
    blocks: tuple[str, ...] = ()
    numbers: Mapping[str, float] = field(default_factory=dict)
    command: str = "u"
    motion: str = "slew"
    lexicon: Lexicon = CRANE

    def following(self, log: Log) -> str:
        """What to type next: no model of ours takes its numbers."""
        return (
            f"Next: cosim diagnose {console.typed(log.source)} --mapping {console.typed(self.mapping)} --calibrate fits the "
            "machine's model to the log and names what it lacks"
        )

    def integrates(self, log: Log) -> bool:
        """Whether a command makes a speed and a place was measured."""
        if self.motion not in log:
            return False
        unit = log.units[self.motion]
        # of FMUs nobody knows more than what was measured
        return "mechanical" in self.blocks and not is_speed(unit) if self.blocks else unit in PLACES


def known_beside(settings: Iterable[str], other: Other | None) -> dict[str, float]:
    """``component.parameter`` -> SI: of the crane, or of the machine; those of `settings` replaced.

    Raises:
        UsageError: a setting is malformed or unknown.
    """
    if other is None:
        return nominal(settings)
    own = {f"{c}.{p}": v for c, of in ABSENT.items() if c not in other.blocks for p, v in of.items()}
    return nominal(settings, own | dict(other.numbers))
