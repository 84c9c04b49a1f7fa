"""How much smaller or larger than on the crane changes typically are: where searches begin (docs/machines.md)."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.integrate import cumulative_trapezoid

from cosim.logs import Log
from cosim.machines.rough import reach, swing, typical_speed
from cosim.machines.table import MachineTable, block_of
from cosim.machines.values import LINEAR, Numbers
from fmus import registry

# what the crane reaches at full command: 2.375 mm, 12.5 bar, 1056 N m, 2.27 deg/s (SYSTEM section 7), 58 deg (Table 3.4)
COMMAND, SPOOL, PRESSURE, TORQUE, SPEED, ANGLE = 1.0, 2.375e-3, 1.254e6, 1056.0, 3.96e-2, 1.012
DEAD_ZONE = (
    0.4  # of the crane's 0.45 is where the dead zone of a machine without a compensator is looked for first
)
SPEEDS = (
    "omega_s",
    "omega_v",
    "drift",
)  # in rad/s; all others of this unit are frequencies, which are not scaled
TRAVELS = ("b_r", "b_l", "play")  # parameters without a unit that are a part of the command
OFF = 1e-9


@dataclass(frozen=True)
class Sizes:
    """What each quantity reaches on either side in the logs, SI; 0 where nothing is known.

    Attributes:
        command, spool, pressure, torque, speed, angle: of the chain's inner signals too, through its gains.
    """

    command: float = 0.0
    spool: float = 0.0
    pressure: float = 0.0
    torque: float = 0.0
    speed: float = 0.0
    angle: float = 0.0

    @classmethod
    def of(
        cls,
        machine: MachineTable,
        numbers: Numbers,
        inner: Mapping[str, str],
        gains: Mapping[str, float],
        logs: Sequence[Log],
        sample: float = 1.0,
        rates: Collection[str] = (),
    ) -> "Sizes":
        """What logs of the machine reach.

        Args:
            machine: the chain.
            numbers: its parameters.
            inner: component -> signal that measures its output.
            gains: signal -> the variable per signal, SI.
            logs: the logs.
            sample: what one unit of their time counts as, s.
            rates: signals that show a speed.
        """
        if not logs:
            return cls()

        def swung(name: str) -> float:
            return swing(np.concatenate([log.require(name) for log in logs])) * abs(gains.get(name, 1.0))

        def measured(component: str) -> float:
            name = inner.get(component)
            return swung(name) if name and all(name in log for log in logs) else 0.0

        values = numbers.values
        first = swung(machine.input)
        command = 0.0 if machine.chain[0] in ("continuity", "mechanical") else first
        spool = measured("dcv") or command * values.get("dcv.K", 0.0)
        pressure = measured("continuity") or spool * values.get("continuity.K_c", 0.0)
        pressure = first if machine.chain[0] == "mechanical" else pressure
        torque = pressure * values.get("mechanical.A", 0.0) * values.get("mechanical.r", 0.0)
        angle = speed = 0.0
        if machine.moves and all(machine.output in log for log in logs):
            each = [
                (log.time * sample, log.require(machine.output) * gains.get(machine.output, 1.0))
                for log in logs
            ]
            seen = np.concatenate([values for _, values in each])
            if machine.output in rates:
                speed = float(np.quantile(np.abs(seen), 0.99))
                angle = max(reach(cumulative_trapezoid(own, time, initial=0.0)) for time, own in each)
            else:
                angle = reach(seen)
                speed = max(typical_speed(time, own, numbers.lag) for time, own in each)
        if values.get("mechanical.b") and speed > 0.0:
            torque = max(torque, values["mechanical.b"] * speed)
        return cls(command, spool, pressure, torque, speed, angle)


def scales(
    machine: MachineTable, numbers: Numbers, sizes: Sizes, given: Mapping[str, float]
) -> dict[str, float]:
    """``component.parameter`` -> factor on where a search begins, for every parameter that an effect frees.

    A factor that the mapping gives, for the parameter or its unit, stands.
    """
    found: dict[str, float] = {}
    for effect in registry.effects().values():
        if effect.component not in machine.chain or effect.only:
            continue
        own = block_of(effect.component).parameters
        for parameter, item in (effect.free | effect.forms).items():
            if item.phase or parameter.startswith("theta_"):
                continue  # a direction is one on every machine
            variable = effect.parameters.get(parameter) or own[parameter]
            name = f"{effect.component}.{parameter}"
            if name in given or variable.unit in given:
                continue
            factor = factor_of(name, variable.unit, numbers.values, sizes)
            value = numbers.values.get(name, 0.0)
            if name in LINEAR and value and own[parameter].start:
                factor = abs(value / own[parameter].start)
            if factor > OFF and f"{factor:.3g}" != "1":
                found[name] = float(f"{factor:.3g}")
    return found


def factor_of(name: str, unit: str, values: Mapping[str, float], sizes: Sizes) -> float:
    """The machine's reach over the crane's, of the quantity that a parameter is made of; 0 where nothing is known."""
    parameter = name.partition(".")[2]
    if parameter in TRAVELS:
        nominal = values.get(name, 0.0)
        return sizes.command / COMMAND * (1.0 if nominal or parameter == "play" else DEAD_ZONE)
    if unit == "rad/s":
        return sizes.speed / SPEED if parameter in SPEEDS else 0.0
    ratios = {
        "m": sizes.spool / SPOOL,
        "m/s": sizes.spool / SPOOL,
        "Pa": sizes.pressure / PRESSURE,
        "N.m": sizes.torque / TORQUE,
        "rad": sizes.angle / (0.5 * ANGLE),
    }
    if unit == "N.m.s/rad":  # of a mass that the file gives no friction
        return ratios["N.m"] * SPEED / sizes.speed if sizes.speed > OFF else 0.0
    if unit == "1/Pa":
        return 1.0 / ratios["Pa"] if ratios["Pa"] > OFF else 0.0
    if unit == "Pa/m":
        return ratios["Pa"] / ratios["m"] if ratios["m"] > OFF else 0.0
    return ratios.get(unit, 0.0)
