"""Evidence in the mechanics: torque that the measured pressure delivers and the model's motion does not need."""

from itertools import pairwise
from types import SimpleNamespace

import numpy as np
from numpy.typing import NDArray

from cosim.diagnosis.answer.schema import NamedCause
from cosim.diagnosis.record.torque import TORQUE_CUTOFF, cutoff_for
from cosim.report.material import Material
from cosim.report.names import kind_of_motion
from cosim.report.picture import Layer, Panel, Picture
from cosim.report.series import binned, reversals
from cosim.report.words import CAPTIONS, at_start, axis, effect_name, lacking, quantity, shows_speed
from fmus import registry

Array = NDArray[np.float64]

EDGE = 0.5  # s at either end, where the smoothing has no neighbours
STRIDE = 0.02  # s between points shown
POINTS = 300.0  # shown of a short log
DEG = np.pi / 180.0
BAR = 1e5


class Motion:
    """Measured motion, smoothed, and the torque that is left over, at points every `STRIDE`; all SI, (k,).

    missing = A r PL - J alpha - b omega - torques of the other named causes   (4.27)

    Raises:
        LookupError: pressure or motion was not measured.
    """

    def __init__(self, material: Material, cause: NamedCause) -> None:
        h, signals = material.h, material.measured
        part = material.parts.get("mechanical")
        drive, angle = ("p_load", "slew") if part is None else (part.drive, next(iter(part.noise)))
        if drive not in signals or angle not in signals:
            raise LookupError(f"the torque needs {drive} and {angle}")
        span = signals[angle].size * h
        cutoff, stride = cutoff_for(span), min(STRIDE, span / POINTS)
        pick = points(material, stride)
        shown = material.smooth(signals[angle], cutoff)
        if shows_speed(angle):
            theta, omega, alpha = np.cumsum(shown) * h, shown, material.slopes(shown)[0]
        else:
            theta, (omega, alpha) = shown, material.slopes(shown)
        pressure = material.smooth(signals[drive], cutoff)
        self.applied = drive != "p_load"
        self.theta, self.omega, self.alpha, self.pressure = (v[pick] for v in (theta, omega, alpha, pressure))
        self.area = material.nominal("mechanical.A") * material.nominal("mechanical.r")
        self.inertia = material.value("mechanical.J", cause)
        self.damping = material.value("mechanical.b", cause)
        felt = self.pressure
        others = np.zeros_like(self.omega)
        for other in material.answer.causes:
            if other.effect == cause.effect:
                continue
            if other.effect == "continuity.cracking_pressure":
                felt = opened(felt, material, other)
            others += law(material, other, self) - shared(material, cause, other, self)
        self.needed = self.inertia * self.alpha + self.damping * self.omega + others
        self.missing = self.area * felt - self.needed
        self.independent = 2.0 * cutoff * stride


def points(material: Material, stride: float = STRIDE) -> NDArray[np.intp]:
    """Samples shown: every `stride` s, without the edges of each log."""
    found = []
    for low, high in pairwise((0, *material.cuts, material.time.size)):
        edge = min(round(EDGE / material.h), (high - low) // 4)
        found.append(np.arange(low + edge, high - edge, max(1, round(stride / material.h))))
    return np.concatenate(found)


def opened(pressure: Array, material: Material, cause: NamedCause) -> Array:
    """Pressure behind the counterbalance valve that a cause says there is, Pa: the effect's own equation."""
    effect = registry.effects()[cause.effect]
    values = {
        n: material.size(cause, n) if n in cause.parameters else v.start for n, v in effect.parameters.items()
    }
    felt, parameters = effect.fills["driving_pressure"], SimpleNamespace(**values)
    return np.array([felt(p, None, parameters) for p in pressure.tolist()])


def shared(material: Material, cause: NamedCause, other: NamedCause, motion: Motion) -> Array:
    """The part of another cause's torque that is the shown one's too: friction at standstill goes on top of the dry one."""
    pair = {cause.effect, other.effect}
    if pair != {"mechanical.coulomb_friction", "mechanical.stribeck_friction"}:
        return np.zeros_like(motion.omega)
    dry = cause if cause.effect == "mechanical.coulomb_friction" else other
    return law(material, dry, motion)


def law(material: Material, cause: NamedCause, motion: Motion) -> Array:
    """Torque (k,) against positive motion that a named cause adds, N m; zero for one that acts elsewhere."""

    def size(name: str) -> float:
        return material.size(cause, name)

    omega, zero = motion.omega, np.zeros_like(motion.omega)
    sign = np.tanh(omega / size("omega_v")) if "omega_v" in cause.parameters else np.sign(omega)
    if cause.effect == "mechanical.coulomb_friction":
        return size("tau_c") * sign
    if cause.effect == "mechanical.stribeck_friction":
        return (size("tau_c") + size("tau_s") * np.exp(-((omega / size("omega_s")) ** 2))) * sign
    if cause.effect == "mechanical.constant_load":
        return size("tau_load") + zero
    if cause.effect == "mechanical.coulomb_asymmetry":
        return size("tau_d") + zero
    if cause.effect == "mechanical.viscous_asymmetry":
        return size("a_b") * motion.damping * np.abs(omega)
    if cause.effect == "mechanical.gravity_load":
        return size("tau_g") * np.sin(motion.theta - size("theta_g"))
    if cause.effect == "mechanical.gear_ripple":
        return -size("tau_r") * np.sin(size("n_r") * motion.theta + size("phi_r"))
    # a changed J or b is in the motion's own inertia and damping already, but for the cause that is shown
    return zero


def _drawn(
    key: str,
    title: str,
    x: Array,
    y: Array,
    labels: tuple[str, str],
    line: tuple[Array, Array],
    motion: Motion,
    caption: str,
) -> Picture:
    """Points, their means in bins, the nominal model's nothing and the cause's law."""
    at, mean, error = binned(x, y, motion.independent)
    edges = np.array([x.min(), x.max()])
    layers = [
        Layer("points", "measured", "measured", x, y),
        Layer("line", "nominal model", "nominal", edges, np.zeros(2)),
        Layer("line", "extended model", "extended", *line),
        Layer("means", "mean in bins, ±2 standard errors", "plain", at, mean, error),
    ]
    return Picture(key, title, labels[0], [Panel(labels[1], layers)], caption)


def over_speed(material: Material, cause: NamedCause) -> Picture:
    """Missing torque against speed: Coulomb, Stribeck and viscous friction."""
    motion = Motion(material, cause)
    speed = np.linspace(motion.omega.min(), motion.omega.max(), 801)
    if cause.effect == "mechanical.viscous_friction":
        torque = (material.size(cause, "b") - motion.damping) * speed
    else:
        torque = law_over(material, cause, motion, omega=speed)
    (text, unit, scale), (of, force, _) = quantity("omega"), lacking("torque")
    return _drawn(
        f"evidence-{cause.effect.replace('.', '-')}",
        f"{at_start(of)} against {text}: {effect_name(cause.effect)}",
        motion.omega * scale,
        motion.missing,
        (axis(text, unit), axis(of, force)),
        (speed * scale, torque),
        motion,
        kind_of_motion(CAPTIONS["applied_over_speed" if motion.applied else "over_speed"]),
    )


def over_angle(material: Material, cause: NamedCause) -> Picture:
    """Missing torque against the angle: gravity and gear ripple."""
    motion = Motion(material, cause)
    angle = np.linspace(motion.theta.min(), motion.theta.max(), 801)
    torque = law_over(material, cause, motion, theta=angle)
    (text, unit, scale), (of, force, _) = quantity("theta"), lacking("torque")
    return _drawn(
        f"evidence-{cause.effect.replace('.', '-')}",
        f"{at_start(of)} against {text}: {effect_name(cause.effect)}",
        motion.theta * scale,
        motion.missing,
        (axis(text, unit), axis(of, force)),
        (angle * scale, torque),
        motion,
        kind_of_motion(CAPTIONS["applied_over_angle" if motion.applied else "over_angle"]),
    )


def over_acceleration(material: Material, cause: NamedCause) -> Picture:
    """Missing torque against acceleration: inertia."""
    motion = Motion(material, cause)
    ends = np.array([motion.alpha.min(), motion.alpha.max()])
    torque = (material.size(cause, "J") - motion.inertia) * ends
    caption = CAPTIONS["over_acceleration"]
    return _drawn(
        "evidence-mechanical-inertia",
        "Missing torque against acceleration",
        motion.alpha / DEG,
        motion.missing,
        (axis("slew acceleration", "deg/s2"), axis("missing torque", "N.m")),
        (ends / DEG, torque),
        motion,
        caption,
    )


def law_over(
    material: Material,
    cause: NamedCause,
    motion: Motion,
    omega: Array | None = None,
    theta: Array | None = None,
) -> Array:
    """The law of a cause over a grid of speeds or angles."""
    grid = omega if omega is not None else theta
    assert grid is not None
    view = object.__new__(Motion)
    view.damping = motion.damping
    view.omega = omega if omega is not None else np.zeros_like(grid)
    view.theta = theta if theta is not None else np.zeros_like(grid)
    return law(material, cause, view)


def over_pressure(material: Material, cause: NamedCause) -> Picture:
    """Pressure that the motion needs against the measured one: the cracking pressure."""
    motion = Motion(material, cause)
    x, y = motion.pressure / BAR, motion.needed / motion.area / BAR
    grid = np.linspace(x.min(), x.max(), 401)
    felt = opened(grid * BAR, material, cause) / BAR
    at, mean, error = binned(x, y - x, motion.independent)
    top = [
        Layer("points", "measured", "measured", x, y),
        Layer("line", "nominal model", "nominal", grid, grid),
        Layer("line", "extended model", "extended", grid, felt),
    ]
    below = [
        Layer("points", "measured", "measured", x, y - x),
        Layer("line", "nominal model", "nominal", grid[[0, -1]], np.zeros(2)),
        Layer("line", "extended model", "extended", grid, felt - grid),
        Layer("means", "mean in bins, ±2 standard errors", "plain", at, mean, error),
    ]
    return Picture(
        "evidence-continuity-cracking_pressure",
        "Pressure felt by the mechanics against pressure measured",
        axis("measured load pressure", "bar"),
        [Panel(axis("pressure needed", "bar"), top), Panel(axis("difference", "bar"), below)],
        CAPTIONS["over_pressure"],
    )


def lost_motion(material: Material, cause: NamedCause) -> Picture:
    """Angle lost after each reversal against the travel since: backlash.

    Raises:
        LookupError: the log holds no reversal that would show it.
    """
    driven = material.without(cause, "slew")
    if driven is None:
        raise LookupError("the prediction without backlash was not kept")
    gap = material.size(cause, "gap")
    rest = material.smooth(material.measured["slew"] - driven, 2.0 * TORQUE_CUTOFF)
    turns = reversals(driven, max(1.5 * gap, 1e-3))
    stride = max(1, round(0.01 / material.h))
    travels, losses = [], []
    for k, end, direction in turns:
        before = rest[max(0, k - round(0.02 / material.h)) : k + 1].mean()
        span = slice(k, end, stride)
        travel = direction * (driven[span] - driven[k])
        # up to where the drive turns back a little, which would cross the gap again unseen
        away = np.flatnonzero(np.maximum.accumulate(travel) - travel > 0.1 * gap)
        near = (travel <= 5.0 * gap) & (np.arange(travel.size) < (away[0] if away.size else travel.size))
        travels.append(travel[near])
        losses.append(-direction * (rest[span][near] - before))
    if not travels:
        raise LookupError("no reversal in this log")
    x, y = np.concatenate(travels) / DEG, np.concatenate(losses) / DEG
    at, mean, error = binned(x, y, 4.0 * TORQUE_CUTOFF * 0.01)
    grid = np.array([0.0, gap, max(5.0 * gap, 1.1 * gap)]) / DEG
    layers = [
        Layer("points", f"measured, {len(turns)} reversals", "measured", x, y),
        Layer("line", "nominal model", "nominal", grid[[0, -1]], np.zeros(2)),
        Layer("line", "extended model", "extended", grid, np.minimum(grid, gap / DEG)),
        Layer("means", "mean in bins, ±2 standard errors", "plain", at, mean, error),
    ]
    return Picture(
        "evidence-mechanical-backlash",
        "Motion lost after a reversal",
        axis("travel of the driving side since the reversal", "deg"),
        [Panel(axis("motion lost", "deg"), layers)],
        CAPTIONS["lost_motion"],
    )


def spectrum(material: Material, cause: NamedCause) -> Picture:
    """Spectrum of the angle residual with and without the cause: a flexible mode shows as a peak."""
    from scipy.signal import welch

    driven = material.without(cause, "slew")
    extended = material.series["block_extended"].get("slew")
    if driven is None or extended is None:
        raise LookupError("the prediction without the flexible mode was not kept")
    measured, h = material.measured["slew"], material.h
    length = min(measured.size, round(10.0 / h))
    layers = []
    for name, role, predicted in (("without it", "nominal", driven), ("with it", "extended", extended)):
        frequency, power = welch(measured - predicted, 1.0 / h, nperseg=length, detrend="linear")
        seen = (frequency >= 0.2) & (frequency <= 30.0)
        layers.append(Layer("line", name, role, frequency[seen], np.sqrt(power[seen]) / DEG))  # type: ignore[arg-type]
    mode = material.size(cause, "w_f") / (2.0 * np.pi)
    y = np.concatenate([layer.y for layer in layers])
    layers.append(
        Layer(
            "line",
            f"boom alone, column locked: {mode:.2f} Hz",
            "plain",
            np.full(2, mode),
            np.array([y.min(), y.max()]),
        )
    )
    return Picture(
        "evidence-mechanical-compliance",
        "Spectrum of the angle residual",
        axis("frequency", "Hz"),
        [Panel("residual [deg/√Hz]", layers, log=True)],
        CAPTIONS["spectrum"],
        log=True,
    )
