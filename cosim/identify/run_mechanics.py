"""``cosim identify mechanics``: from a log, and what its mapping says of the machine, to `Answer`."""

from collections.abc import Mapping, Sequence
from typing import Protocol

from scipy.integrate import cumulative_trapezoid

from cosim import console
from cosim.errors import DataError, UsageError
from cosim.identify import picture
from cosim.identify.answer import COLUMNS, Answer, parameter_table
from cosim.identify.data import even, measured, travels
from cosim.identify.inverse_dynamics import LOG_PARTS, OPTIONAL, Mechanics, Motion, identify_mechanics
from cosim.identify.nominal import declared
from cosim.identify.run import log_data
from cosim.lexicon import Lexicon, speaking
from cosim.logs import Log
from cosim.logs.mapping import Mapping as LogMapping
from cosim.report.names import kind_of_motion
from cosim.ssp.system import Port
from cosim.units import parse_quantity

COMPONENT = "mechanical"


class Wired(Protocol):
    """What is known of a machine's wiring."""

    @property
    def blocks(self) -> Mapping[str, str]:
        """Component -> block."""

    @property
    def values(self) -> Mapping[str, float]:
        """``component.parameter`` -> SI."""


class Shows(Protocol):
    """What a signal stands for."""

    @property
    def source(self) -> Port | None:
        """The output that it measures."""

    @property
    def targets(self) -> tuple[Port, ...]:
        """The inputs that it feeds."""

    @property
    def gain(self) -> float:
        """The variable per signal, SI."""


class Machine(Protocol):
    """What must be known of a machine to read its torque and angle."""

    @property
    def name(self) -> str:
        """Of its model."""

    @property
    def wiring(self) -> Wired:
        """Of its model."""

    @property
    def values(self) -> Mapping[str, float]:
        """``component.parameter`` -> SI that its mapping adds."""

    @property
    def signals(self) -> Mapping[str, Shows]:
        """What its signals stand for."""

    @property
    def lexicon(self) -> Lexicon:
        """Its words."""

    @property
    def mapping(self) -> LogMapping | None:
        """With which its logs are read."""


PRESSURE = (Port(COMPONENT, "p_load"),)
ANGLE = (Port(COMPONENT, "theta"), Port("sensor", "slew"))
VELOCITY = (Port(COMPONENT, "omega"),)
WITHOUT = ("J", "b", "tau_c", "tau_load", "theta_0")  # what is looked for, and the start


def mechanics_answer(
    log: Log, machine: Machine, settings: Sequence[str] = (), highest: float | None = None
) -> Answer:
    """Inertia, friction and a constant load of a log's machine.

    Args:
        log: the log.
        machine: which of its signals are load pressure and angle, and what is known of it.
        settings: numbers taken as known, such as ``mechanical.r=120 mm``.
        highest: frequency [Hz] up to which torque and motion are compared; by default as far as they belong together.

    Raises:
        DataError: the log lacks a signal, or the numbers cannot be found from it.
        UsageError: a setting is malformed or not of the mechanics.
    """
    with speaking(machine.lexicon):
        found = identify_mechanics(motion_of(log, machine, settings), highest)
    values = {f"{COMPONENT}.{name}": q for name, q in found.values.items()}
    data = {
        **log_data([log]),
        "best_fit_percent": found.fit,
        "held_out_percent": {
            "as_found": found.held_out,
            "inertia_and_viscous_friction": found.without_friction,
        },
        "highest_frequency": {"value": found.highest, "unit": "Hz"},
        "share_in_motion": float(found.used.mean()),
        "not_shown": {f"{COMPONENT}.{name}": q.as_data() for name, q in found.not_shown.items()},
    }
    ours = machine.name if machine.name == "full_order" else ""
    answer = Answer(
        "mechanics",
        data,
        values,
        notes=list(log.warnings),
        model=ours,
        lexicon=machine.lexicon,
        following="" if ours else _following(log, machine),
    )
    with speaking(machine.lexicon):
        before = {**machine.wiring.values, **machine.values}
        title = f"torque and motion up to {found.highest:.3g} Hz, best fit {found.fit:.2f} %"
        answer.tables.append((title, COLUMNS, parameter_table(values, before)))
        answer.lines += _sentences(found, machine.lexicon)
    answer.draw = lambda: picture.mechanics_figure(found, machine.lexicon)
    return answer


def _following(log: Log, machine: Machine) -> str:
    """What to type next with the numbers of a machine that is not the crane."""
    if machine.mapping is None or machine.mapping.path is None:
        return ""
    return (
        f"Next: cosim diagnose {console.typed(log.source)} --mapping {console.typed(machine.mapping.path)} --calibrate fits "
        "the machine's model to the log and names what it lacks"
    )


def motion_of(log: Log, machine: Machine, settings: Sequence[str] = ()) -> Motion:
    """Torque and angle of a log; where a speed was measured and no angle, its integral.

    Raises:
        DataError: the log lacks a signal or one does not move.
        UsageError: a setting is malformed or not of the mechanics.
    """
    values = known_values(machine, settings)
    log, _ = even(log)
    pressure, to_pascal = _signal(machine, log, PRESSURE)
    torque = values["A"] * values["r"] * to_pascal * travels(log, pressure, driven=True)
    speed = None if _standing_for(machine, log, ANGLE) else _standing_for(machine, log, VELOCITY)
    shown, factor = speed or _signal(machine, log, ANGLE)
    radians = factor * travels(log, shown)
    if speed:
        radians = cumulative_trapezoid(radians, dx=log.step, initial=0.0)
    keep = measured(log, pressure, shown)
    return Motion(log.name, log.step, torque, radians, keep, values, float(log.time[0]))


def known_values(machine: Machine, settings: Sequence[str]) -> dict[str, float]:
    """Parameter of the mechanics -> SI, without those that are looked for."""
    if COMPONENT not in machine.wiring.blocks:
        blocks = ", ".join(machine.wiring.blocks)
        raise UsageError(
            f"the model '{machine.name}' has no block '{COMPONENT}' between a torque and an angle, but {blocks}"
        )
    values = {
        name.partition(".")[2]: value
        for name, value in {**machine.wiring.values, **machine.values}.items()
        if name.startswith(f"{COMPONENT}.")
    }
    for text in settings:
        name, equals, quantity = (part.strip() for part in text.partition("="))
        component, _, parameter = name.partition(".")
        if not equals or not quantity or component != COMPONENT or parameter in WITHOUT:
            raise UsageError(
                f"--set '{text}' should give a number that the mechanics are known by, such as mechanical.r=120 mm"
            )
        values[parameter] = parse_quantity(quantity, declared(name).unit)
    return {name: value for name, value in values.items() if name not in WITHOUT}


def _standing_for(machine: Machine, log: Log, ports: Sequence[Port]) -> tuple[str, float] | None:
    """Name of the signal that stands for the first of these variables that was measured, and the factor to it."""
    for port in ports:
        for name, item in machine.signals.items():
            if name in log and (port in item.targets or port == item.source):
                return name, item.gain
    return None


def _signal(machine: Machine, log: Log, ports: Sequence[Port]) -> tuple[str, float]:
    """The same, where there has to be one."""
    if found := _standing_for(machine, log, ports):
        return found
    if not machine.lexicon.signals:
        log.require("p_load" if ports is PRESSURE else "slew", "the mechanics")
    raise DataError(
        f"{log.source}: no signal stands for {ports[0]}, without which the mechanics cannot be judged: say which one does in"
        " [compare.signals] of the mapping"
    )


def _sentences(found: Mechanics, lexicon: Lexicon) -> list[str]:
    extra = [n for n in OPTIONAL if n in found.values]
    beside = f"; with inertia and viscous friction alone {found.without_friction:.4g} %" if extra else ""
    lines = [
        f"How well it fits: of {LOG_PARTS} parts of the log, each predicted from the others, it tells "
        f"{found.held_out:.4g} % of the {kind_of_motion('torque')}{beside}",
        f"the drive moves in {found.used.mean():.0%} of the log; samples at rest say nothing and are left out",
    ]
    what = {"tau_c": "no dry friction", "tau_load": "no constant load"}
    for name, quantity in found.not_shown.items():
        unit, scale = lexicon.parameter(declared(f"{COMPONENT}.{name}"))
        low, high = (scale * end for end in quantity.interval)
        lines.append(f"{what[name]} shows in this log ({low:.3g} to {high:.3g} {unit}): taken as 0")
    if {"tau_c", "tau_load"} <= found.values.keys():
        lines.append(
            "in motion a constant load cannot be told from dry friction that differs between the directions"
        )
    if found.one_way and "tau_c" in found.values:
        lines.append(
            "the drive moves one way only: what is told as dry friction is that and a constant load together; record motion "
            "the other way as well to tell them apart"
        )
    return lines
