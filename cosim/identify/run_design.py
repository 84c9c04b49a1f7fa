"""The subcommands of ``cosim identify`` that design or prepare: observer, scaling, experiment; and all blocks at once."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cosim import console
from cosim.errors import DataError, UsageError
from cosim.identify import picture
from cosim.identify.answer import COLUMNS, Answer, parameter_table
from cosim.identify.blocks import BLOCKS, form, parameters
from cosim.identify.dead_zone import identify_dead_zone
from cosim.identify.estimate import Quantity
from cosim.identify.experiment import GRIDS, SINE_AMPLITUDE, Experiment, ramp, stepped_sine
from cosim.identify.other_machine import Other
from cosim.identify.run import channel, dead_zone_parameters, log_data, model_of, record_notes, records_of
from cosim.identify.scaling import (
    STANDARD,
    TABLES,
    Channel,
    calibrate,
    mapping_text,
    read_points,
    volt_columns,
    wire_over_disc,
)
from cosim.identify.state_space import (
    Observer,
    RootLocus,
    StateSpace,
    design_observer,
    drive,
    error_dynamics,
    modal_form,
    observer_values,
    root_locus,
)
from cosim.identify.transfer_function import fit_records
from cosim.logs import Log
from cosim.logs.load import open_source
from cosim.report.names import known_as

Array = NDArray[np.float64]
DEGREE = np.pi / 180.0
FULL_ORDER = ((4.582e5,), (1.0, 71.5, 2164.0, 3.673e4, 2.02e5, 0.0))  # (5.12), degrees
CHAIN = ("dcv", "continuity", "mechanical")


def all_answer(
    log: Log, known: Mapping[str, float], cutoff: float | None, other: Other | None = None
) -> Answer:
    """Dead zone, valve, pressure and mechanics from one log, as far as it holds their signals.

    Raises:
        DataError: it holds none of them, or excites none enough.
    """
    numbers, notes = dict(known), list[str]()
    values, fits, left_out = dict[str, Quantity](), dict[str, float](), dict[str, str]()
    if "u" in log and "spool" in log:
        zone = identify_dead_zone(log, numbers, cutoff=cutoff)
        values |= dead_zone_parameters(zone)
        fits["dead_zone"] = zone.best_fit
        notes += [
            f"{log.name}: {note}" for note in zone.notes
        ]  # as those of the blocks, so that none is said twice
        for name in ("dead_zone.b_r", "dead_zone.b_l"):
            if name in values and not values[name].interval[0] <= numbers[name] <= values[name].interval[1]:
                notes.append(
                    f"{name} is {values[name].value:.5g}, not {numbers[name]:g}: the valve is identified with the one found"
                )
                numbers[name] = values[name].value
    for block in CHAIN:
        wanted = channel(block, None, None, cutoff=cutoff)
        missing = [name for name in (wanted.source, wanted.target) if name not in log]
        if missing:
            left_out[block] = f"the log has no {' and no '.join(missing)}"
            continue
        items = records_of([log], wanted, numbers)
        try:
            model = fit_records(items, form(block).structure)
            model.check_known()
        except DataError as error:  # one block that the log does not excite costs only its own numbers
            left_out[block] = str(error)
            continue
        values |= parameters(block, model, numbers)
        fits[block] = model.best_fit
        notes += record_notes(items)
    if not fits:
        remedy = (
            "For u and slew alone take `cosim identify transfer-function --block simplified`"
            if other is None
            else "`cosim identify drive` takes the machine's static curve from command and motion alone"
        )
        raise DataError(f"{log.source}: {'; '.join(left_out.values())}: no block can be identified. {remedy}")
    data = {**log_data([log]), "best_fit_percent": fits, "left_out": left_out}
    answer = Answer("all", data, values, notes=[*dict.fromkeys(notes)], model=model_of(values, other))
    if other is not None:
        answer.following = other.following(log)
    answer.tables.append((f"identified from {log.source.name}", COLUMNS, parameter_table(values, known)))
    answer.lines.append("best fit: " + ", ".join(f"{name} {value:.2f} %" for name, value in fits.items()))
    answer.lines += [f"{block} left out: {why}" for block, why in left_out.items()]
    if "mechanical" in left_out and "p_load" in log and "slew" in log:
        answer.lines.append(
            "cosim identify mechanics takes inertia and friction from pressure and angle, without poles"
        )
    return answer


def observer_answer(
    log: Log | None,
    known: Mapping[str, float],
    poles: Sequence[float],
    cutoff: float | None,
    other: Other | None = None,
) -> Answer:
    """State space, its ranks, the observer's gain and the root locus; the drive from a log, or the nominal one (4.15)."""
    gain, pole = known["simplified.k"] / DEGREE, known["simplified.a"]
    origin, notes, found = "nominal (4.15)", [], {}
    if log is not None:
        chosen = channel("simplified", None, None, cutoff=cutoff)
        if other is not None:
            log.require(other.motion, "the observer")
            if log.units[other.motion] != "rad":
                raise UsageError(
                    f"{log.source}: the observer is of an angle, and '{other.motion}' is in {log.display[other.motion]}"
                )
            chosen = replace(chosen, source=other.command, target=other.motion, integrates=True)
        items = records_of([log], chosen, known)
        model = fit_records(items, BLOCKS["simplified"].structure)
        model.check_known()
        found = parameters("simplified", model, known)
        gain, pole = found["simplified.k"].value / DEGREE, found["simplified.a"].value
        origin = f"{log.source.name}, best fit {model.best_fit:.2f} %"
        notes = record_notes(items)
    plant = drive(gain, pole)
    observer = design_observer(plant, poles)
    loci = {"simplified (5.1)": root_locus([gain], [1.0, pole, 0.0])}
    if other is None:
        loci["full order (5.12)"] = root_locus(*FULL_ORDER)
    values = found | {
        name: Quantity(value, 0.0, 1.0, _unit(name)) for name, value in observer_values(observer).items()
    }
    data = {
        **(log_data([log]) if log is not None else {}),
        "model": {"A": plant.A, "B": plant.B, "C": plant.C, "angles": "deg", "origin": origin},
        "controllability_rank": plant.controllability,
        "observability_rank": plant.observability,
        "plant_poles": plant.poles,
        "observer_poles": list(observer.poles),
        "L": observer.gain,
        "modal_form": {"plant": _modal(plant), "error": _modal(error_dynamics(observer))},
        "root_locus": {
            name: {
                "stable_below": locus.limit,
                "unit": "1/deg",
                "phase_margin_at_1": {"value": locus.margins[1], "unit": "deg"},
            }
            for name, locus in loci.items()
        },
    }
    answer = Answer("observer", data, values, notes=notes, model=model_of({}, other))
    if other is not None and log is not None:
        answer.following = other.following(log)
    ends, gains = observer.poles, observer.gain
    answer.lines = [
        f"drive, {origin}: theta/u = {gain:.5g} / (s (s + {pole:.5g})), deg",
        f"observer poles {ends[0]:.5g} and {ends[1]:.5g} 1/s: L = [{gains[0]:.5g}, {gains[1]:.5g}]",
        *_locus_lines(loci),
    ]
    answer.details = _observer_lines(observer)
    answer.draw = lambda: picture.root_locus_figure(loci, observer)
    return answer


def _observer_lines(observer: Observer) -> list[str]:
    """Matrices, ranks and modal forms in words."""
    plant = observer.plant
    lines = [
        f"A = {plant.A.tolist()}, B = {plant.B.tolist()}, C = {plant.C.tolist()}",
        f"rank of controllability {plant.controllability}, of observability {plant.observability}, of 2 states",
    ]
    for name, system in (("plant", plant), ("error (2.16)", error_dynamics(observer))):
        try:
            modes = modal_form(system)
        except UsageError:
            continue  # two poles coincide
        rows = ", ".join(f"{p + 0.0:.4g}" for p in modes.poles)
        b, c = (", ".join(f"{x:.4g}" for x in part.ravel()) for part in (modes.B, modes.C))
        lines.append(f"modal form of the {name}: poles {rows} 1/s, B = [{b}], C = [{c}]")
    return lines


def _locus_lines(loci: Mapping[str, RootLocus]) -> list[str]:
    """How much proportional gain each loop bears."""
    lines = []
    for name, locus in loci.items():
        limit = (
            f"stable below a gain of {locus.limit:.4g} /deg"
            if np.isfinite(locus.limit)
            else "stable at every gain"
        )
        lines.append(
            f"proportional control of {name}: {limit}, phase margin {locus.margins[1]:.3g} deg at 1 /deg"
        )
    return lines


def _modal(system: StateSpace) -> dict[str, Array] | None:
    try:
        found = modal_form(system)
    except UsageError:
        return None  # two poles coincide
    return {"poles": found.poles, "T": found.T, "B": found.B, "C": found.C}


def _unit(name: str) -> str:
    from cosim.identify.nominal import declared

    return declared(name).unit


def scaling_answer(
    file: Path | None, points: Sequence[str], columns: Sequence[str], radius: float | None, time: str
) -> Answer:
    """Scaling of the channels, and a mapping file for a log in volts.

    Raises:
        UsageError: a point or column is malformed, or a channel has no scaling.
        DataError: the log has no column in volts.
    """
    channels = dict(STANDARD)
    if radius is not None:
        channels["slew"] = wire_over_disc(radius)
    measured = {name: calibrate(name, pairs) for name, pairs in read_points(points).items()}
    channels |= measured
    chosen = {} if file is None else _columns(file, columns)
    lacking = [name for name in chosen if name not in channels]
    if lacking:
        raise UsageError(
            f"no scaling is known for {', '.join(lacking)}: give two points, such as --point '{lacking[0]}=1.0 V:0 deg',"
            " or for the slew sensor --disc-radius"
        )
    shown = [channels[name] for name in chosen] or list(channels.values())
    data = {
        "log": None if file is None else str(file),
        "channels": {c.signal: _channel_data(c) for c in shown},
        "tables": {name: [_table_point(*pair) for pair in pairs] for name, pairs in TABLES.items()},
    }
    answer = Answer("scaling", data)
    rows: list[list[object]] = [
        [c.signal, f"{c.gain:.6g} {c.unit}/V", f"{c.zero:.5g} V", c.source] for c in shown
    ]
    answer.tables.append(("value = gain (voltage - zero)  (3.2)", ["signal", "gain", "zero", "source"], rows))
    answer.brief = [_scaled(c) for c in shown]
    answer.brief.append(_how_sure(shown))
    answer.details += [
        f"{name}: spool feedback {volts:g} V is {value:g} mm there, {STANDARD['spool'].value(volts):.4g} mm by 3.5 mm/V"
        for name, pairs in TABLES.items()
        for volts, value in pairs
    ]
    if chosen:
        answer.texts["mapping.toml"] = mapping_text(channels, chosen, time, "s")
        answer.following = _read_with(file)
    else:
        answer.following = (
            "Next: name a log recorded in volts: cosim identify scaling LOG --out DIR writes its mapping"
        )
    answer.draw = lambda: picture.scaling_figure(shown)
    return answer


def _read_with(file: Path | None) -> Callable[[Mapping[str, Path]], str]:
    """What to type next with the mapping, once it is known where it lies."""

    def following(written: Mapping[str, Path]) -> str:
        if "mapping.toml" not in written:
            return "Next: the same with --out DIR writes mapping.toml, with which every command reads the log (--mapping)"
        log, mapping = (console.typed(p) for p in (file or Path("LOG"), written["mapping.toml"]))
        return f"Next: cosim info {log} --mapping {mapping} shows the log in these units"

    return following


def _scaled(c: Channel) -> str:
    """``spool position (spool): 3.5 mm/V from zero at 2.5 V``, with intervals where points told them."""
    unit = f"{c.unit if c.unit != '1' else 'of full command'} a volt"
    gain, zero = f"{c.gain:.5g}", f"{c.zero:.4g}"
    if c.errors is not None:
        gain, zero = (f"{q.value:.5g} ({q.interval[0]:.5g} to {q.interval[1]:.5g})" for q in c.errors)
    return f"{known_as(c.signal)}: {gain} {unit}, zero at {zero} V: {c.source}"


def _how_sure(shown: Sequence[Channel]) -> str:
    """Which of the lines were measured, and how far their points lie off."""
    parts = []
    for c in shown:
        if c.points:
            worst = max(abs(r) for r in c.residuals)
            less = "" if c.errors else "; two points leave nothing to judge by, a third one would"
            known = "in brackets 95 % intervals" if c.errors else "no interval"
            parts.append(
                f"{c.signal} from {len(c.points)} points, none further off than {worst:.3g} {c.unit}, {known}{less}"
            )
    given = [c.signal for c in shown if not c.points]
    if given:
        points = "" if parts else ": measured points (--point) replace them"
        parts.append(
            f"{', '.join(given)} from the data sheets and tables of the source, not measured here{points}"
        )
    return f"How sure: {'; '.join(parts)}"


def _columns(file: Path, named: Sequence[str]) -> dict[str, str]:
    """Signal -> column of a log in volts."""
    if not named:
        return volt_columns([(label.name, label.unit) for label in open_source(file).labels], str(file))
    found = {}
    for text in named:
        signal, equals, column = (part.strip() for part in text.partition("="))
        if not equals or not column:
            raise UsageError(f"--column '{text}' should read signal=column, such as spool='Ch 3'")
        found[signal] = column
    return found


def _channel_data(c: Channel) -> dict[str, object]:
    gain, zero = c.errors or (None, None)
    return {
        "gain": gain.as_data() if gain else {"value": c.gain, "unit": f"{c.unit}/V"},
        "zero": zero.as_data() if zero else {"value": c.zero, "unit": "V"},
        "unit": c.unit,
        "source": c.source,
        "points": [{"voltage": v, "value": y} for v, y in c.points],
    }


def _table_point(volts: float, value: float) -> dict[str, float]:
    return {"voltage": volts, "table_mm": value, "scaled_mm": STANDARD["spool"].value(volts)}


def experiment_of(
    name: str,
    amplitudes: Sequence[float],
    band: tuple[float, float, int] | None,
    periods: int,
    square: bool = False,
) -> Experiment:
    """The experiment `name`: ``slew``, ``dcv``, ``ramp``, or ``sine`` over a band (lowest, highest [rad/s], count).

    With `square`, square waves of the same frequencies in place of sines.

    Raises:
        UsageError: there is no such experiment, or its numbers make no sense.
    """
    if name == "ramp":
        if len(amplitudes) > 1:
            raise UsageError("a ramp has one amplitude")
        if square:
            raise UsageError(
                "a ramp has no periods that could be square: --square goes with slew, dcv and sine"
            )
        return ramp(amplitudes[0] if amplitudes else 1.0, periods)
    if name == "sine":
        if band is None or not 0.0 < band[0] < band[1] or band[2] < 2:
            raise UsageError(
                "the experiment 'sine' needs a band: --low, --high (rad/s) and --count of at least 2"
            )
        return stepped_sine(name, np.geomspace(*band), tuple(amplitudes) or (SINE_AMPLITUDE,), square)
    if name not in GRIDS:
        raise UsageError(f"'{name}' is no experiment: choose {', '.join([*GRIDS, 'ramp', 'sine'])}")
    grid, levels = GRIDS[name]
    return stepped_sine(name, grid, tuple(amplitudes) or levels, square)
