"""From a mapping with a table ``[machine]`` to a wiring that every command takes, and to what the diagnosis asks of it."""

import hashlib
import re
from collections.abc import Mapping as Values
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from cosim.compare.binding import DEFAULTS, START_PARAMETER, START_SIGNAL, gain_between
from cosim.compare.mapping import CompareTable, Target, load_mapping
from cosim.errors import DataError, UsageError
from cosim.lexicon import ELECTRIC_DRIVER
from cosim.logs import Log, Mapping, listed
from cosim.machines.flow import set_by_flow
from cosim.machines.scale import Sizes, scales
from cosim.machines.table import (
    FULL_COMMAND,
    SCALE_FREE,
    UNKNOWN,
    MachineTable,
    block_of,
    machine_table,
    without_unit,
)
from cosim.machines.values import LINEAR, Numbers, inner_signals, numbers
from cosim.machines.wiring import entry, files, outlet, wires, write_files
from cosim.paths import build_folder
from cosim.signals import SIGNALS
from cosim.ssp.read import read_system
from cosim.ssp.system import System
from cosim.units import parse_quantity, parse_unit, same_kind
from fmus import registry

BAR = 1e5  # Pa
# what friction, inertia and damping are where a pressure is all that is known of what drives
OF_PRESSURE = {"N.m": "bar", "kg.m2": "bar.s2/{0}", "N.m.s/rad": "bar.s/{0}"}
SHORTEST_STEP = 1e-3  # s that the step of a simulation needs at most to be
# signals of the pressure that drives the motion, or that the load makes
SHOWN_BY_LOAD = ("p_load", "p_a", "p_b")
STEPS_A_SAMPLE, STEPS_A_LAG = 5.0, 10.0  # steps of a simulation between two samples, and in a lag, at least
# what the driver of a motor can do of that which a valve can: come late, be limited in rate and size, be off
DRIVER = ("dcv.delay", "dcv.rate_limit", "dcv.stroke_limit", "dcv.offset")
# of a flow that nothing moves, only the valve's part and what scales it or holds it back
OF_A_FLOW = ("mechanical.inertia", "mechanical.viscous_friction", "continuity.flow_asymmetry")
# of a drive that holds the place it is told, its lag: friction and loads are its controller's business. Play of the gear
# stands where that of a valve does, and a place has no dead zone about its zero
OF_A_PLACE = ("mechanical.inertia", "mechanical.viscous_friction")
PLAY = "dcv.hysteresis"
MOTOR = {"dcv": ELECTRIC_DRIVER, "continuity": "winding", "mechanical": "motor"}  # block -> what it is called
# effects that change one gain; between two signals only the last block's gain is asked for
GAINS = {
    "dcv": ("dcv.gain",),
    "continuity": ("continuity.flow_gain", "continuity.leakage"),
    "sensor": ("sensor.gain",),
}


@dataclass(frozen=True)
class Made:
    """A machine, made.

    Attributes:
        ssd: the wiring, with the values it binds beside it.
        table: what its signals stand for, and where its motion starts.
        diagnose: the mapping's table ``[diagnose]``, completed.
        machine: the table it was made from.
        numbers: its parameters.
        sizes: what its signals reach.
    """

    ssd: Path
    table: CompareTable
    diagnose: dict[str, Any]
    machine: MachineTable
    numbers: Numbers
    sizes: Sizes = field(default_factory=Sizes)


def made_for(mapping: Path, log: Log | Sequence[Log] | None = None, folder: Path | None = None) -> Made:
    """The machine of a mapping file.

    Args:
        mapping: the file; it has a table ``[machine]``.
        log: a log of the machine, or several, which together tell what the file leaves open and how large changes typically
            are.
        folder: where the wiring goes; by default a folder named by its content in the build folder.

    Raises:
        DataError: the file is wrong, or the logs do not tell what is unknown.
        UsageError: something is unknown and there is no log, or a unit does not fit.
    """
    plain, given = load_mapping(mapping)
    if not plain.machine:
        raise DataError(f"{mapping}: there is no table [machine] from which a model could be made")
    machine = machine_table(plain, mapping)
    wires(machine, mapping)  # a chain that does not fit together is said before anything is asked of a log
    logs = () if log is None else listed(log)
    first = logs[0] if logs else None  # all were read with this mapping: their units and clocks are the same
    signals = targets(machine, plain, given, first)
    variables = {name: target.variable for name, target in signals.items()}
    inner = inner_signals(machine, {**known_signals(logs), **variables})
    gains = gains_of(machine, signals, first)
    sample = second(plain, first)
    rates = speeds(signals)
    why = flow_sets(machine, inner, logs, sample, rates)
    aside = {n: why for n in SHOWN_BY_LOAD if why and n not in signals}
    inner = {c: n for c, n in inner.items() if n not in aside}
    aside |= unstated_supply(machine, signals, first)
    told = numbers(machine, inner, gains, logs, sample, rates)
    name = re.sub(r"\W+", "_", plain.name or mapping.stem).strip("_").lower() or "machine"
    component, _, variable = signals[machine.output].variable.partition(".")
    last = (component, variable) if component == machine.chain[-1] else None
    content = files(machine, told.values, name, plain.description or plain.name, mapping, last)
    if folder is None:
        digest = hashlib.sha256(b"".join(content.values())).hexdigest()[:12]
        folder = build_folder() / "machines" / f"{name}-{digest}"
    write_files(content, folder)
    start = dict(given.start)
    for component in machine.chain:
        if START_PARAMETER in block_of(component).parameters and machine.output not in {START_SIGNAL, *rates}:
            start.setdefault(f"{component}.{START_PARAMETER}", machine.output)
    told_of = {"aside": aside, "notes": (*without_unit(machine), *beyond_one(machine, logs))}
    table = given.model_copy(update={"signals": signals, "start": start, **told_of})
    sizes = Sizes.of(machine, told, inner, gains, logs, sample, rates)
    diagnose = completed(
        plain.diagnose, machine, told, inner, sizes, driven_by_pressure(machine, plain, first)
    )
    # numbers that the file states count to a percent, and each block hands on with up to half a step's delay
    if told.from_log and told.lag > 0.0:
        diagnose.setdefault("step", longest_step(logs, told.lag, sample))
    return Made(folder / f"{name}.ssd", table, diagnose, machine, told, sizes)


def beyond_one(machine: MachineTable, logs: Sequence[Log]) -> list[str]:
    """What to say of a command that goes beyond 1 where the file states the speed that a command of 1 brings."""
    own = [log[machine.input] for log in logs if machine.input == "u" and "u" in log]
    largest = max((float(np.abs(values).max()) for values in own), default=0.0)
    if machine.speed in (None, UNKNOWN) or machine.places or largest <= SIGNALS["u"].high:
        return []
    return [
        f'u goes to {largest:.3g}: speed = "{machine.speed}" is then what a command of 1 brings, and not full command; if '
        f"it is that of full command, say gain = {1.0 / largest:.3g} of u"
    ]


def unstated_supply(machine: MachineTable, signals: dict[str, Target], log: Log | None) -> dict[str, str]:
    """A supply pressure that was measured and of which nothing is said: the crane's 170 bar is that of no other machine."""
    if log is None or "p_supply" not in log or "p_supply" in signals or "continuity" not in machine.chain:
        return {}
    if "continuity.p_s" in machine.parameters:
        return {}
    return {
        "p_supply": "p_supply is not judged: [machine.parameters] does not say what it is ('continuity.p_s')"
    }


def flow_sets(
    machine: MachineTable, inner: dict[str, str], logs: Sequence[Log], sample: float, rates: set[str]
) -> str:
    """Why the chain is not cut at the load pressure, where flow and not pressure sets the motion; else empty.

    Of several logs most must show it.
    """
    pressure = inner.get("continuity")
    known = [log for log in logs if all(n in log for n in (pressure or "", machine.input, machine.output))]
    if pressure != "p_load" or not known or not machine.moves or machine.forced:
        return ""
    found = [
        set_by_flow(
            log.time * sample,
            *(log.require(n) for n in (machine.input, pressure, machine.output)),
            integrates=machine.output not in rates,
        )
        for log in known
    ]
    shown = [why for why in found if why]
    if 2 * len(shown) <= len(found):
        return ""
    return (
        f"p_a and p_b are left aside: {shown[0]}, so flow sets the speed here and the load makes the pressure; what lies "
        f"between {machine.input} and {machine.output} is judged as one"
    )


def longest_step(logs: Sequence[Log], lag: float, sample: float) -> str:
    """Step in which the diagnosis simulates a machine, as a mapping says it: fine beside its lag and its log, and no finer.

    Args:
        logs: the logs.
        lag: of the chain, s.
        sample: what one unit of their time counts as, s.
    """
    interval = min(float(np.median(np.diff(log.time))) for log in logs) * sample
    fine = min(interval / STEPS_A_SAMPLE, lag / STEPS_A_LAG)
    return f"{float(max(fine, SHORTEST_STEP)):.6g} s"


def known_signals(logs: Sequence[Log]) -> dict[str, str]:
    """Signals of our names that all logs hold, with what they stand for."""
    return {n: v for n, v in DEFAULTS.items() if all(n in log for log in logs)} if logs else {}


def speeds(signals: dict[str, Target]) -> set[str]:
    """Signals that stand for a speed."""
    found = set()
    for name, target in signals.items():
        component, _, variable = target.variable.partition(".")
        outputs = block_of(component).outputs if component in registry.BLOCKS else {}
        if variable in outputs and outputs[variable].unit == "rad/s":
            found.add(name)
    return found


def targets(
    machine: MachineTable, plain: Mapping, given: CompareTable, log: Log | None = None
) -> dict[str, Target]:
    """What each signal stands for: as the mapping says, else input and output of the chain (a speed by its unit).

    Raises:
        DataError: the mapping has no such signal.
    """
    found = dict(given.signals)
    own = plain.signals.get(machine.output)
    unit = (own.unit if own else None) or (log.units.get(machine.output) if log is not None else None)
    for name, (component, variable), way in (
        (machine.input, entry(machine), "input"),
        (machine.output, outlet(machine, unit), "output"),
    ):
        if name not in plain.signals:
            others = [n for n in plain.signals if n not in (machine.input, machine.output)]
            more = f'; say {way} = "{others[0]}" in [machine]' if len(others) == 1 else ""
            if name == "p_load" and {"p_a", "p_b"} <= set(plain.signals):
                one, two = (plain.signals[n] for n in ("p_a", "p_b"))
                between = f'torque = {{ column = "{one.column}", minus = "{two.column}", unit = "{one.unit or "bar"}" }}'
                more = f"; where their difference drives the machine, map it: {between}"
            raise DataError(
                f"{plain.path}: machine.{way} = '{name}' is no signal of [signals]: it has {', '.join(plain.signals)}{more}"
            )
        block = block_of(component)
        unit = (block.inputs | block.outputs)[variable].unit
        factor = stands_for(machine, unit)
        if machine.forced and way == "input" and name not in found:
            factor = None if driven_by_pressure(machine, plain, log) else factor
        found.setdefault(name, Target(variable=f"{component}.{variable}", factor=factor))
    return found


def driven_by_pressure(machine: MachineTable, plain: Mapping, log: Log | None) -> bool:
    """Whether the mechanics are driven by a pressure, whose area nobody stated, and not by a force or torque.

    Raises:
        DataError: it is neither.
    """
    own = plain.signals.get(machine.input)
    unit = (own.unit if own else None) or (log.units.get(machine.input) if log is not None else None)
    if not machine.forced or unit is None:
        return False
    kind = parse_unit(unit).dimensionality
    force, other = ("N", "N.m") if machine.motion == "travel" else ("N.m", "N")
    if kind == parse_unit(other).dimensionality:
        motion = "turn" if machine.motion == "travel" else "travel"
        raise DataError(
            f"{plain.path}: signals.{machine.input}: '{unit}' is a {'force' if other == 'N' else 'torque'}, and the axis "
            f'{"turns" if other == "N" else "travels"}: say motion = "{motion}" in [machine], or give it the other unit'
        )
    if kind not in [parse_unit(u).dimensionality for u in ("Pa", force)]:
        raise DataError(
            f"{plain.path}: signals.{machine.input}: what drives 'mechanical' is a {'force' if force == 'N' else 'torque'} "
            f"[{force}] or a pressure, and no '{unit}'; of a drive that logs per cent of its rating, the rating / 100 is "
            "the 'gain' (1 where nobody knows it: all that is found is then in per cent)"
        )
    return kind == parse_unit("Pa").dimensionality


def stands_for(machine: MachineTable, unit: str) -> str | None:
    """The variable per signal, where the two differ in kind: a length for an angle, a force for a pressure."""
    shown = machine.units.get(unit)
    if unit == "Pa" and machine.forced:
        return "1 Pa/N" if machine.motion == "travel" else "1 Pa/(N.m)"
    return None if shown is None else f"1 {unit}/({shown})"


def in_package(system: System, plain: Mapping, given: CompareTable) -> dict[str, Target]:
    """What a machine's input and output stand for in a package made of it, where the two differ in kind.

    Its connectors have the blocks' units: a travel in m is an angle in rad there.

    Args:
        system: the package, such as the extended model of a diagnosis.
        plain: the machine's mapping; of one without ``[machine]`` nothing is known.
        given: what it says its signals stand for.
    """
    if not plain.machine or plain.path is None:
        return {}
    machine = machine_table(plain, plain.path)
    units = {n: item.unit for n, item in system.inputs.items()}
    units |= {n: system.variable(port).unit for n, port in system.outputs.items()}
    found = {}
    for name in (machine.input, machine.output):
        if name in units and name in plain.signals and name not in given.signals:
            own, factor = plain.signals[name].unit, stands_for(machine, units[name])
            # a package of somebody's own may have the motion's unit
            if factor is not None and (own is None or not same_kind(own, units[name])):
                found[name] = Target(variable=name, factor=factor)
    return found


def table_in_package(source: Path, plain: Mapping | None, given: CompareTable) -> CompareTable:
    """What signals stand for in the package of a file, with what a machine's stand for there (`in_package`)."""
    if plain is None or not plain.machine:
        return given
    with read_system(source) as system:
        return given.model_copy(update={"signals": {**given.signals, **in_package(system, plain, given)}})


def gains_of(machine: MachineTable, signals: dict[str, Target], log: Log | None) -> dict[str, float]:
    """Signal of the log -> the variable per signal, SI."""
    found = {}
    for name, target in signals.items():
        component, _, variable = target.variable.partition(".")
        if log is not None and name in log.units and component in machine.chain:
            block = block_of(component)
            known = block.inputs | block.outputs
            if variable not in known:
                raise UsageError(
                    f"compare.signals: '{component}' has no '{variable}' for the signal '{name}'; "
                    f"{registry.suggestion(variable, known)}"
                )
            unit = known[variable].unit
            found[name] = gain_between(name, log.units[name], unit, target.factor)
    return found


def second(plain: Mapping, log: Log | None) -> float:
    """What one unit of a log's time counts as, s."""
    text = plain.diagnose.get("sample")
    if log is None or log.time_unit == "s" or not isinstance(text, str):
        return 1.0
    try:
        return parse_quantity(text, "s")
    except UsageError as error:
        raise DataError(f"{plain.path}: 'diagnose.sample': {error}") from None


def completed(
    given: dict[str, Any],
    machine: MachineTable,
    told: Numbers,
    inner: dict[str, str],
    sizes: Sizes,
    by_pressure: bool = False,
) -> dict[str, Any]:
    """The table ``[diagnose]`` with what follows from the chain, where the file does not say it."""
    found = dict(given)
    stated = [n for n in (*machine.parameters, *told.from_log) if n in LINEAR]
    if machine.speed is not None or machine.lag is not None:
        pair = (
            ("mechanical.J", "mechanical.b")
            if "mechanical" in machine.chain
            else ("simplified.k", "simplified.a")
        )
        stated += pair
    if not {"trusted", "free"} & found.keys():
        found["free" if told.from_log else "trusted"] = list(dict.fromkeys(stated))
    found["exclude"] = list(dict.fromkeys([*given.get("exclude", ()), *not_here(machine, inner)]))
    if machine.places:
        found["held"] = [machine.output]
    own = {**machine.units, **scale_free(machine, inner, told.values)}
    if by_pressure:  # on one square metre (or cubic metre a radian) a newton is a pascal
        length = machine.units.get("rad", "rad")
        own |= {si: f"{1.0 / BAR:g} {text.format(length)}" for si, text in OF_PRESSURE.items()}
        own.pop("Pa", None)
    found["units"] = {**own, **given.get("units", {})}
    found["scale"] = {**scales(machine, told, sizes, given.get("scale", {})), **given.get("scale", {})}
    axis = {"travel": {"mechanical": "axis"}, "flow": {"mechanical": "flow"}}.get(machine.motion, {})
    if machine.drive == "electric":
        axis = MOTOR | axis
    found["blocks"] = {"sensor": "sensor", **axis, **given.get("blocks", {})}
    return found


def scale_free(machine: MachineTable, inner: dict[str, str], values: Values[str, float]) -> dict[str, str]:
    """Units of torque, inertia and friction, spool and pressure where only their ratio to full command's can be known."""
    gains = {"dcv.K", "continuity.K_c", "mechanical.A", "mechanical.r", "mechanical.J", "mechanical.b"}
    commanded = "mechanical" in machine.chain and machine.chain[0] != "mechanical"
    if "continuity" in inner and "dcv" in machine.chain and "dcv" not in inner:
        return of_spool_alone(machine, values)
    if not commanded or {"dcv", "continuity"} & set(inner) or gains & set(machine.parameters):
        return {}
    length = machine.units.get("rad", "rad")
    return {si: text.format(length) for si, text in SCALE_FREE.items()} | parts_of_full(machine, values)


def parts_of_full(machine: MachineTable, values: Values[str, float]) -> dict[str, str]:
    """Units of spool and pressure that nobody has measured: parts of what full command brings."""
    found = {}
    if "dcv" in machine.chain:
        spool = values["dcv.K"]
        found = {"m": f"{1.0 / spool:.6g} full command", "m/s": f"{1.0 / spool:.6g} full command/s"}
        if "continuity" in machine.chain:
            found["Pa"] = f"{1.0 / (spool * values['continuity.K_c']):.6g} full command"
    return found


def of_spool_alone(machine: MachineTable, values: Values[str, float]) -> dict[str, str]:
    """Units of a spool that nobody has measured in front of a pressure that was: nothing tells its millimetres."""
    if {"dcv.K", "continuity.K_c"} & set(machine.parameters):
        return {}
    spool = {si: text for si, text in parts_of_full(machine, values).items() if si != "Pa"}
    return spool | {"Pa/m": f"{values['dcv.K'] / BAR:.6g} bar/{FULL_COMMAND}"}


def not_here(machine: MachineTable, inner: dict[str, str]) -> list[str]:
    """Effects that no signal of this machine can show, or that are one number with another."""
    found = (
        ["continuity.supply_sag"]
        if "continuity" in machine.chain and "p_supply" not in inner.values()
        else []
    )
    if machine.drive == "electric":
        found += [
            name
            for name in registry.effects()
            if name.partition(".")[0] in ("dcv", "continuity") and name not in DRIVER
            if not (machine.places and name == PLAY)
        ]
    if machine.motion == "flow" or machine.places:
        kept = OF_A_PLACE if machine.places else OF_A_FLOW
        found += [
            name
            for name in registry.effects()
            if name.partition(".")[0] in ("mechanical", "continuity") and name not in kept
        ]
    if machine.places:
        found.append("dead_zone.mismatch")
    for component, behind in zip(machine.chain, machine.chain[1:], strict=False):
        carries = block_of(behind).name in ("continuity", "mechanical", "simplified")
        if component not in inner and carries:
            found += GAINS.get(component, ())
    if machine.chain[-1] == "sensor" and not {"spool", "p_load"} & set(inner.values()):
        found += GAINS["sensor"]
    return found


def write_machine(mapping: Path, folder: Path, log: Log | None = None) -> tuple[Made, list[Path]]:
    """Write the wiring, the values and the package of a machine for other tools.

    Returns:
        The machine, and its files: .ssd, .ssv of each component, .ssp.

    Raises:
        DataError, UsageError, ModelError: as `made_for`, or the folder cannot be written to.
    """
    from cosim.ssp.write import write_as_wired

    try:
        made = made_for(mapping, log, folder)
        package = write_as_wired(made.ssd, folder / f"{made.ssd.stem}.ssp")
    except OSError as error:
        raise UsageError(
            f"cannot write into '{folder}' ({error.strerror or error}); name another folder"
        ) from None
    return made, [made.ssd, *(folder / f"{c}.ssv" for c in made.machine.chain), package]
