"""Evidence in the sensors: the slew reading against the model's angle, its rate, time, and the tracker."""

import numpy as np
from numpy.typing import NDArray

from cosim.diagnosis.answer.schema import NamedCause
from cosim.report.material import BLOCK_EXTENDED, Material
from cosim.report.picture import Layer, Panel, Picture, Role
from cosim.report.series import binned
from cosim.report.torque import points
from cosim.report.words import CAPTIONS, axis, effect_name

Array = NDArray[np.float64]

READING_CUTOFF = 5.0  # Hz
DEG = np.pi / 180.0
BINS = "mean in bins, ±2 standard errors"
ZOOM = 2.0  # s
MOVING = 0.2  # of the greatest speed: slower is standstill, or nearly
SEAM = 12.0 * DEG  # Table 3.4: below it the tracker uses its first marker model


def against_model(material: Material, cause: NamedCause) -> Picture:
    """Angle residual without the cause against the angle (gain), time (drift) or speed (lag).

    Raises:
        LookupError: the prediction was not kept.
    """
    driven = material.without(cause, "slew")
    if driven is None:
        raise LookupError("the prediction without the sensor's error was not kept")
    residual = material.smooth(material.measured["slew"] - driven, READING_CUTOFF)
    pick = points(material)
    if cause.effect == "sensor.gain":
        x, slope, label = driven, material.size(cause, "gain") - 1.0, axis("predicted slew angle", "deg")
    elif cause.effect == "sensor.drift":
        x, slope, label = material.time, material.size(cause, "drift"), axis("time", "s")
    else:  # tau_l d(reading)/dt = angle - reading
        x = material.slopes(material.smooth(material.measured["slew"], READING_CUTOFF))[0]
        slope, label = -material.size(cause, "tau_l"), axis("measured slew speed", "deg/s")
    scale = 1.0 if cause.effect == "sensor.drift" else DEG
    return _slope(
        cause,
        x[pick] / scale,
        residual[pick] / DEG,
        slope * scale / DEG,
        label,
        axis("angle residual", "deg"),
    )


def _slope(
    cause: NamedCause, x: Array, y: Array, slope: float, label: str, ordinate: str, fixed: bool = False
) -> Picture:
    """Points, bins, and a line of the named slope through their middle, or through zero where the level is known."""
    level = 0.0 if fixed else float(np.mean(y - slope * x))
    ends = np.array([x.min(), x.max()])
    at, mean, error = binned(x, y, 2.0 * READING_CUTOFF * 0.02)
    layers = [
        Layer("points", "measured", "measured", x, y),
        Layer("line", "nominal model", "nominal", ends, np.zeros(2)),
        Layer("line", "extended model", "extended", ends, level + slope * ends),
        Layer("means", BINS, "plain", at, mean, error),
    ]
    what = effect_name(cause.effect)
    return Picture(
        f"evidence-{cause.effect.replace('.', '-')}",
        f"Slew reading off: {what}",
        label,
        [Panel(ordinate, layers)],
        CAPTIONS["slope"],
    )


def against_tracker(material: Material, cause: NamedCause) -> Picture:
    """Slew reading less tracker: against the angle (gain, bias, seam), time (drift) or speed (clock).

    Raises:
        LookupError: there was no tracker.
    """
    if not material.tracker:
        raise LookupError("no tracker")
    time, reading, stamp = (material.tracker[k] for k in ("time", "reading", "stamp"))
    slew = material.smooth(material.measured["slew"], 2.0 * READING_CUTOFF)
    if cause.effect == "tracker.clock":
        # the mean speed between the two instants is that half way
        speed = np.interp(0.5 * (stamp + time), material.time, material.slopes(slew)[0])
        off = np.interp(stamp, material.time, slew) - reading
        offset = material.size(cause, "offset")
        return _slope(
            cause,
            speed / DEG,
            off / DEG,
            -offset,
            axis("slew speed", "deg/s"),
            axis("slew less tracker", "deg"),
        )
    angle = np.interp(time, material.time, slew)
    off = (angle - reading) / DEG
    if cause.effect == "sensor.drift":
        drift = material.size(cause, "drift") / DEG
        labels = axis("time", "s"), axis("slew less tracker", "deg")
        return _slope(cause, time, off, drift, *labels)
    grid = np.unique(np.concatenate([np.linspace(angle.min(), angle.max(), 200), [SEAM - 1e-9, SEAM]]))
    grid = grid[(grid >= angle.min()) & (grid <= angle.max())]
    expected = {
        role: (material.value("sensor.gain", but) - 1.0) * grid
        + material.value("sensor.bias", but)
        - material.value("tracker.seam", but) * (grid < SEAM)
        for role, but in (("nominal", cause), ("extended", None))
    }
    at, mean, error = binned(angle / DEG, off, 0.25)
    layers = [
        Layer("points", "measured", "measured", angle / DEG, off),
        Layer("line", "without it", "nominal", grid / DEG, expected["nominal"] / DEG),
        Layer("line", "with it", "extended", grid / DEG, expected["extended"] / DEG),
        Layer("means", BINS, "plain", at, mean, error),
    ]
    return Picture(
        f"evidence-{cause.effect.replace('.', '-')}",
        f"Slew sensor against tracker: {effect_name(cause.effect)}",
        axis("slew angle by the sensor", "deg"),
        [Panel(axis("slew less tracker", "deg"), layers)],
        CAPTIONS["against_tracker"],
    )


def sensor(material: Material, cause: NamedCause) -> Picture:
    """Against the tracker where there is one, else against the model."""
    if material.tracker and cause.effect != "sensor.lag":
        return against_tracker(material, cause)
    return against_model(material, cause)


def staircase(material: Material, cause: NamedCause) -> Picture:
    """The raw reading, enlarged where it moves slowly: quantisation.

    Raises:
        LookupError: the prediction was not kept.
    """
    extended = material.series[BLOCK_EXTENDED].get("slew")
    without = material.without(cause, "slew")
    if extended is None or without is None:
        raise LookupError("the predictions were not kept")
    h, slew = material.h, material.measured["slew"]
    width = min(round(ZOOM / h), slew.size // 2)
    travel = np.abs(without[width:] - without[:-width])
    # three to four steps in the window show the stairs best
    first = int(np.argmin(np.abs(travel - 3.5 * material.size(cause, "quantum"))))
    span = slice(first, first + width)
    time = material.time[span]
    layers = [
        Layer("points", "measured, every sample", "measured", time, slew[span] / DEG),
        Layer("line", "without it", "nominal", time, without[span] / DEG),
        Layer("line", "with it", "extended", time, extended[span] / DEG),
    ]
    return Picture(
        "evidence-sensor-quantisation",
        "The slew reading, enlarged",
        axis("time", "s"),
        [Panel(axis("slew angle", "deg"), layers)],
        CAPTIONS["staircase"],
    )


def limit(material: Material, cause: NamedCause) -> Picture:
    """Where the reading stays longest at an end of the travel or of the sensor's range: measured, without and with it.

    Raises:
        LookupError: the predictions were not kept, or the log never stays there.
    """
    extended = material.series[BLOCK_EXTENDED].get("slew")
    without = material.without(cause, "slew")
    if extended is None or without is None:
        raise LookupError("the predictions were not kept")
    slew = material.smooth(material.measured["slew"], 2.0 * READING_CUTOFF)
    ends = [material.size(cause, name) for name in cause.parameters]
    near = 0.01 * float(np.ptp(slew))
    still = np.concatenate([[False], np.min([np.abs(slew - end) for end in ends], axis=0) < near, [False]])
    begins, closes = np.flatnonzero(~still[:-1] & still[1:]), np.flatnonzero(still[:-1] & ~still[1:])
    if not begins.size:
        raise LookupError("the log never stays at an end")
    longest = int(np.argmax(closes - begins))
    around = closes[longest] - begins[longest]
    span = slice(max(0, begins[longest] - around), min(slew.size, closes[longest] + around))
    pick = np.arange(span.start, span.stop, max(1, (span.stop - span.start) // 2000))
    time = material.time[pick]
    layers = [
        Layer("line", "measured", "measured", time, slew[pick] / DEG),
        Layer("line", "without it", "nominal", time, without[pick] / DEG),
        Layer("line", "with it", "extended", time, extended[pick] / DEG),
    ]
    return Picture(
        f"evidence-{cause.effect.replace('.', '-')}",
        f"The slew angle at its end: {effect_name(cause.effect)}",
        axis("time", "s"),
        [Panel(axis("slew angle", "deg"), layers)],
        CAPTIONS["limit"],
    )


def speed_over_angle(material: Material, cause: NamedCause) -> Picture:
    """Speed against the angle while the drive moves: measured, without and with a linkage.

    Raises:
        LookupError: the predictions were not kept, or the drive never moves.
    """
    extended = material.series[BLOCK_EXTENDED].get("slew")
    without = material.without(cause, "slew")
    if extended is None or without is None:
        raise LookupError("the predictions were not kept")
    pick = points(material)
    layers = []
    told: tuple[tuple[str, Role, Array], ...] = (
        ("measured", "measured", material.measured["slew"]),
        ("without it", "nominal", without),
        ("with it", "extended", extended),
    )
    fastest = 0.0
    for name, role, values in told:
        angle = material.smooth(values, READING_CUTOFF)
        speed = material.slopes(angle)[0][pick] / DEG
        fastest = fastest or float(np.abs(speed).max(initial=0.0))
        if fastest == 0.0:
            raise LookupError("the drive never moves")
        moving = np.abs(speed) > MOVING * fastest
        layers.append(Layer("points", name, role, angle[pick][moving] / DEG, speed[moving]))
    return Picture(
        f"evidence-{cause.effect.replace('.', '-')}",
        f"Speed against the angle: {effect_name(cause.effect)}",
        axis("slew angle", "deg"),
        [Panel(axis("slew speed", "deg/s"), layers)],
        CAPTIONS["speed_over_angle"],
    )


def repeats(material: Material, cause: NamedCause) -> Picture:
    """How often a sample repeats the last one exactly: dropout.

    Raises:
        LookupError: the angle was not measured.
    """
    if "slew" not in material.measured:
        raise LookupError("no slew angle")
    slew = material.measured["slew"]
    same = np.concatenate([[False], np.diff(slew) == 0.0, [False]])
    starts, ends = np.flatnonzero(~same[:-1] & same[1:]), np.flatnonzero(same[:-1] & ~same[1:])
    lengths = ends - starts
    p = material.size(cause, "p_drop")
    longest = int(min(max(lengths.max(initial=1), 3), 8))
    k = np.arange(1, longest + 1, dtype=np.float64)
    seen = np.array([np.sum(lengths == n) for n in k], dtype=np.float64)
    expected = slew.size * (1.0 - p) ** 2 * np.power(p, k)
    layers = [
        Layer("bars", "measured", "measured", k, seen),
        Layer("bars", "expected with it", "extended", k, expected),
    ]
    return Picture(
        "evidence-sensor-dropout",
        "Exactly repeated samples",
        "repeats in a row [1]",
        [Panel("times in the log [1]", layers, log=True)],
        CAPTIONS["repeats"].format(same=int(same.sum()), all=slew.size),
    )
