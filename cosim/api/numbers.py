"""Identifications as they are asked for by `cosim identify`: files, and numbers with units as texts."""

from pathlib import Path
from typing import Any

from cosim.identify.answer import Answer


def everything(
    log: Path,
    mapping: Path | None = None,
    settings: list[str] | None = None,
    cutoff: str | None = None,
    start: str | None = None,
    stop: str | None = None,
) -> Answer:
    """Dead zone, valve, pressure and mechanics from one log, and one .ssv for the model."""
    from cosim.identify.nominal import nominal
    from cosim.identify.run_design import all_answer
    from cosim.identify.texts import load, quantity

    known = nominal(settings or [])
    return all_answer(load(log, mapping, start, stop), known, quantity(cutoff, "Hz", "--filter"))


def dead_zone(
    log: Path,
    response: str | None = None,
    mapping: Path | None = None,
    settings: list[str] | None = None,
    cutoff: str | None = None,
    start: str | None = None,
    stop: str | None = None,
) -> Answer:
    """Break points and slopes of the valve's dead zone, best from a slow ramp."""
    from cosim.errors import UsageError
    from cosim.identify.dead_zone import RESPONSES
    from cosim.identify.nominal import nominal
    from cosim.identify.run import dead_zone_answer
    from cosim.identify.texts import load, quantity

    if response is not None and response not in RESPONSES:
        raise UsageError(f"--response '{response}': choose {', '.join(RESPONSES)}")
    known = nominal(settings or [])
    loaded = load(log, mapping, start, stop)
    return dead_zone_answer(loaded, known, response, quantity(cutoff, "Hz", "--filter"))


def transfer_function(
    logs: list[Path],
    block: str | None = None,
    source: str | None = None,
    target: str | None = None,
    order: list[str] | None = None,
    integrators: int | None = None,
    delay: bool = False,
    linear: bool = False,
    mapping: Path | None = None,
    settings: list[str] | None = None,
    cutoff: str | None = None,
    start: str | None = None,
    stop: str | None = None,
) -> Answer:
    """Transfer functions fitted to logs: a table of candidates, and the one to use, by BIC and held-out fit."""
    from cosim.identify.nominal import nominal
    from cosim.identify.run import channel, transfer_function_answer
    from cosim.identify.texts import load, quantity, structure

    chosen = channel(block, source, target, linear, quantity(cutoff, "Hz", "--filter"))
    at_zero = chosen.integrators if integrators is None else integrators
    structures = [structure(text, at_zero, delay) for text in order or []]
    known = nominal(settings or [])
    loaded = [load(log, mapping, start, stop) for log in logs]
    return transfer_function_answer(loaded, chosen, structures, known)


def frf(
    logs: list[Path],
    block: str | None = None,
    source: str | None = None,
    target: str | None = None,
    method: str = "stepped",
    extremes: bool = False,
    order: str | None = None,
    delay: bool = False,
    segment: str | None = None,
    low: str | None = None,
    high: str | None = None,
    smooth: bool = False,
    smooth_order: int = 11,
    smooth_window: int = 25,
    linear: bool = False,
    mapping: Path | None = None,
    settings: list[str] | None = None,
    cutoff: str | None = None,
    start: str | None = None,
    stop: str | None = None,
) -> Answer:
    """Frequency response with its uncertainty, from stepped sines or by Welch's method, and a fit to it."""
    from cosim.identify.nominal import nominal
    from cosim.identify.run import channel
    from cosim.identify.run_frf import FrfRequest, frf_answer
    from cosim.identify.texts import angular, load, quantity, structure

    chosen = channel(block, source, target, linear, quantity(cutoff, "Hz", "--filter"))
    wanted = FrfRequest(
        method=method,
        amplitude="extremes" if extremes else "least squares",
        structure=None if order is None else structure(order, chosen.integrators, delay),
        segment=quantity(segment, "s", "--segment"),
        low=0.0 if low is None else angular(low, "--low"),
        high=float("inf") if high is None else angular(high, "--high"),
        smooth=(smooth_order, smooth_window) if smooth else None,
    )
    known = nominal(settings or [])
    loaded = [load(log, mapping, start, stop) for log in logs]
    return frf_answer(loaded, chosen, known, wanted)


def mechanics(
    log: Path,
    mapping: Path | None = None,
    settings: list[str] | None = None,
    highest: str | None = None,
    start: str | None = None,
    stop: str | None = None,
) -> Answer:
    """Inertia, viscous and dry friction and a constant load from load pressure (or torque) and angle (4.27)."""
    from cosim.diagnosis.model.choice import machine_of
    from cosim.identify.run_mechanics import mechanics_answer
    from cosim.identify.texts import load, quantity

    loaded = load(log, mapping, start, stop)
    machine = machine_of(None, loaded, mapping)
    return mechanics_answer(loaded, machine, settings or [], quantity(highest, "Hz", "--highest"))


def drive(
    logs: list[Path],
    mapping: Path | None = None,
    command: str | None = None,
    motion: str | None = None,
    start: str | None = None,
    stop: str | None = None,
) -> Answer:
    """Static curve of a drive, speed against command: dead zone, slope and top speed of either side."""
    from cosim.identify.run_drive import drive_answer
    from cosim.identify.texts import load
    from cosim.logs import load_mapping

    plain = load_mapping(mapping) if mapping is not None else None
    loaded = [load(log, mapping, start, stop) for log in logs]
    return drive_answer(loaded, plain, command, motion)


def observer(
    log: Path | None = None,
    pole: list[float] | None = None,
    mapping: Path | None = None,
    settings: list[str] | None = None,
    cutoff: str | None = None,
    start: str | None = None,
    stop: str | None = None,
) -> Answer:
    """State space, controllability, observability, root locus, and the observer's gain from its poles."""
    from cosim.identify.nominal import nominal
    from cosim.identify.run_design import observer_answer
    from cosim.identify.texts import load, quantity

    known = nominal(settings or [])
    loaded = None if log is None else load(log, mapping, start, stop)
    return observer_answer(loaded, known, pole or [], quantity(cutoff, "Hz", "--filter"))


def scaling(
    log: Path | None = None,
    point: list[str] | None = None,
    column: list[str] | None = None,
    disc_radius: str | None = None,
    time: str = "time",
) -> Answer:
    """Volts to millimetres, bar and degrees (Tables 3.5 and 3.6, (3.2)): a mapping file for a log recorded in volts."""
    from cosim.identify.run_design import scaling_answer
    from cosim.identify.texts import quantity

    radius = quantity(disc_radius, "m", "--disc-radius")
    return scaling_answer(log, point or [], column or [], radius, time)


def linearisation(
    start_a: str = "0.15 V",
    start_b: str = "-0.24 V",
    point: list[str] | None = None,
    full: str = "3 V:2.6 mm",
) -> Answer:
    """The valve's voltage for a command so that the spool's travel is linear and the same on both sides (3.5.5)."""
    from cosim.identify.linearisation import linearisation_answer

    return linearisation_answer((start_a, start_b), point or [], full)


def kalman(
    disturbance: str = "100 N.m",
    disturbance_time: str = "1 s",
    sensor_error: str = "0 deg",
    sensor_error_time: str = "10 s",
    slew_noise: str = "0.01 deg",
    pressure_noise: str = "0.1414 bar",
    tracker_noise: str = "0 deg",
    tracker_step: str = "12.5 ms",
    step_size: str = "1 ms",
    settings: list[str] | None = None,
) -> Answer:
    """Gains of the extended observer: the stationary Kalman filter of slew, velocity, disturbance and sensor error."""
    from cosim.identify.kalman import Noises
    from cosim.identify.nominal import nominal
    from cosim.identify.run_kalman import kalman_answer
    from cosim.units import parse_quantity

    noises = Noises(
        slew=parse_quantity(slew_noise, "rad"),
        p_load=parse_quantity(pressure_noise, "Pa"),
        disturbance=parse_quantity(disturbance, "N.m"),
        T_tau=parse_quantity(disturbance_time, "s"),
        sensor_error=parse_quantity(sensor_error, "rad"),
        T_beta=parse_quantity(sensor_error_time, "s"),
        tracker=parse_quantity(tracker_noise, "rad"),
        tracker_step=parse_quantity(tracker_step, "s"),
        step=parse_quantity(step_size, "s"),
    )
    return kalman_answer(nominal(settings or []), noises)


def markers(
    record: Path,
    models: Path,
    residual: str = "1 mm",
    nearest: str = "0 m",
    farthest: str | None = None,
    camera: str = "0,0,0",
) -> Answer:
    """The slew angle from the tracker's marker positions (3.5.4), as a tracker's record, and the seam of the two models."""
    from cosim.errors import UsageError
    from cosim.identify.markers import markers_answer
    from cosim.markers import Limits
    from cosim.units import parse_quantity

    try:
        x, y, z = (float(part) for part in camera.split(","))
    except ValueError:
        raise UsageError(f"--camera '{camera}' should read x,y,z in m, such as '5,0,1.5'") from None
    far = float("inf") if farthest is None else parse_quantity(farthest, "m")
    limits = Limits(parse_quantity(residual, "m"), parse_quantity(nearest, "m"), far, (x, y, z))
    return markers_answer(record, models, limits)


def experiment(
    name: str,
    out: Path,
    amplitude: list[float] | None = None,
    low: str | None = None,
    high: str | None = None,
    count: int = 40,
    periods: int = 2,
    square: bool = False,
) -> dict[str, Any]:
    """Write the command of an experiment; its duration [s], travel [deg] and files."""
    from cosim.errors import UsageError
    from cosim.identify.experiment import write_experiment
    from cosim.identify.run_design import experiment_of
    from cosim.identify.texts import angular

    if out.suffix.lower() != ".csv":
        raise UsageError(f"{out}: a command is written as .csv")
    band = None if low is None or high is None else (angular(low, "--low"), angular(high, "--high"), count)
    made = experiment_of(name, amplitude or [], band, periods, square)
    plan = write_experiment(made, out)
    return {"identify": "experiment", "experiment": name, "duration": {"value": made.duration, "unit": "s"},
            "travel": {"value": made.travel, "unit": "deg"}, "files": {"csv": str(out), "plan": str(plan)}}  # fmt: skip
