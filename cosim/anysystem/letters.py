"""The letters by which equations call quantities: T is a temperature, p a pressure."""

import re

from cosim.ssp.quantities import definition

# (a unit of the quantity, its letters); a letter may stand for several, and what has the unit decides
QUANTITIES: tuple[tuple[str, tuple[str, ...]], ...] = (
    ("K", ("T", "theta", "Theta")),
    ("Pa", ("p", "P")),
    ("m3/s", ("q", "Q")),
    ("m", ("x", "y", "z", "s", "h", "l", "L")),
    ("m/s", ("v",)),
    ("rad", ("phi", "theta", "alpha", "q")),
    ("rad/s", ("w", "omega", "n")),
    ("N", ("f", "F")),
    ("N.m", ("m", "M", "tau", "T")),
    ("V", ("u", "U", "v", "V", "e")),
    ("A", ("i", "I")),
    ("W", ("p", "P")),
)


def letters_of(unit: str) -> tuple[str, ...]:
    """The usual letters of the quantity that has a unit; none where it is not known."""
    own = definition(unit, {}) if unit else None
    if own is None:
        return ()
    for known, letters in QUANTITIES:
        if (other := definition(known, {})) is not None and other.exponents == own.exponents:
            return letters
    return ()


def is_letter(name: str, unit: str) -> bool:
    """Whether a name is, or begins with, the usual letter of the quantity that has a unit: ``T_plate`` and K."""
    first = re.split(r"[_\W\d]", name, maxsplit=1)[0]
    return first in letters_of(unit)
