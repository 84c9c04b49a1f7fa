"""Linear drive of free order that is known by its speed: the equations of the linear drive, one time derivative on.

omega(s)/(u(s) - u_0) = exp(-delay s) sum over k of (b1_k s + b0_k) / (s^2 + a1_k s + a0_k)
"""

import sys
from collections import namedtuple
from dataclasses import replace
from typing import Annotated, Any, NamedTuple

from fmus import linear_drive
from fmus.contract import Block, Buffer, Variable, fields
from fmus.linear import held_pair
from fmus.linear_drive import Coefficients, Input, advanced, began, coefficients, output, resting, start, step
from fmus.ring import RING, ago

FASTER = {"rad": "rad/s", "rad/s": "rad/s2", "rad/s2": "rad/s3"}
TOP, LAG = (
    0.17453292519943295,
    4.4,
)  # rad/s2 and 1/s of (4.15); a lag is a section with one more root in common
NOMINAL = {"b1_1": TOP, "b0_1": TOP * LAG, "a1_1": 2.0 * LAG, "a0_1": LAG * LAG}
__all__ = ["BLOCK", "Coefficients", "Input", "Output", "Parameters", "State"]


def speed_of(name: str, variable: Variable) -> Variable:
    """A variable of the linear drive as one of its speed."""
    found = replace(
        variable,
        unit=FASTER.get(variable.unit, variable.unit),
        display="deg/s" if variable.unit == "rad" else None,
        text=variable.text.replace("angle", "speed").replace("Angle", "Speed"),
    )
    return replace(found, start=NOMINAL[name], source="(4.15), its speed") if name in NOMINAL else found


def faster(layout: Any) -> Any:
    """One of the linear drive's named tuples, an angle being a speed."""
    found = namedtuple(layout.__name__, layout._fields)  # type: ignore[misc]
    found.__doc__ = layout.__doc__
    found.__annotations__ = {n: Annotated[float, speed_of(n, v)] for n, v in fields(layout).items()}
    return found


class Output(NamedTuple):
    """What goes out."""

    omega: Annotated[float, Variable("rad/s", "Speed", display="deg/s")]


State = faster(linear_drive.State)
Parameters = faster(linear_drive.Parameters)


BLOCK = Block(
    name="linear_speed",
    title="Linear drive of free order: command to speed as a log shows it",
    module=sys.modules[__name__],
    reads={"command": "held"},
    memory={"ring": Buffer(RING, "Past commands")},
    helpers=(held_pair, ago, resting, began, start, coefficients, advanced, step, output),
)
