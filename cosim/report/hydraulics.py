"""Evidence in the hydraulics: pressure against spool, its rate, and the supply against the flow."""

import numpy as np
from numpy.typing import NDArray

from cosim.diagnosis.answer.schema import NamedCause
from cosim.report.material import Material
from cosim.report.picture import Layer, Panel, Picture
from cosim.report.series import binned
from cosim.report.torque import points
from cosim.report.words import CAPTIONS, axis, effect_name

Array = NDArray[np.float64]

PRESSURE_CUTOFF = 10.0  # Hz
BAR, MM = 1e5, 1e-3
OPEN = 0.3  # of the widest opening, less than which the ratio of flow to opening is mostly noise
BINS = "mean in bins, ±2 standard errors"


class Pressures:
    """Measured spool and pressure, smoothed, at points; SI, (k,).

    Raises:
        LookupError: spool or pressure was not measured.
    """

    def __init__(self, material: Material) -> None:
        signals = material.measured
        if "spool" not in signals or "p_load" not in signals:
            raise LookupError("the hydraulics need spool and p_load")
        pick = points(material, 0.01)
        spool, pressure = (material.smooth(signals[s], PRESSURE_CUTOFF) for s in ("spool", "p_load"))
        rate, _ = material.slopes(pressure)
        self.spool, self.pressure, self.rate = spool[pick], pressure[pick], rate[pick]
        self.independent = 2.0 * PRESSURE_CUTOFF * 0.01


def extended_pair(material: Material, but: NamedCause | None) -> tuple[float, float]:
    """Gain (Pa/m) and time constant (s) with leakage and compressibility, without cause `but`.

    Raises:
        LookupError: the model's hydraulics are the physical ones, which have neither.
    """
    told = {
        *material.answer.nominal,
        *(f"{c.block}.{p}" for c in material.answer.causes for p in c.parameters),
    }
    if told & {"continuity.w", "continuity.beta"}:
        raise LookupError("gain and time constant are of the identified hydraulics")
    leak = 1.0 + material.value("continuity.c_l", but)
    soft = 1.0 + material.value("continuity.c_beta", but)
    return material.value("continuity.K_c", but) / leak, material.value("continuity.T", but) / leak * soft


def opening(material: Material, spool: Array, but: NamedCause | None) -> Array:
    """Effective opening, m: with the asymmetry of the flow, without cause `but`."""
    return spool * (1.0 + np.sign(spool) * material.value("continuity.a_q", but))


def pressure_curve(material: Material, cause: NamedCause) -> Picture:
    """Steady pressure T dP/dt + P against the spool: gain, asymmetry, leakage."""
    seen = Pressures(material)
    _, T = extended_pair(material, None)
    y = seen.pressure + T * seen.rate
    grid = np.linspace(seen.spool.min(), seen.spool.max(), 201)
    lines = {}
    for role, but in (("nominal", cause), ("extended", None)):
        lines[role] = extended_pair(material, but)[0] * opening(material, grid, but)
    off = y - extended_pair(material, cause)[0] * opening(material, seen.spool, cause)
    at, mean, error = binned(seen.spool / MM, off / BAR, seen.independent)
    top = [
        Layer("points", "measured", "measured", seen.spool / MM, y / BAR),
        Layer("line", "nominal model", "nominal", grid / MM, lines["nominal"] / BAR),
        Layer("line", "extended model", "extended", grid / MM, lines["extended"] / BAR),
    ]
    below = [
        Layer("points", "measured", "measured", seen.spool / MM, off / BAR),
        Layer("line", "nominal model", "nominal", grid[[0, -1]] / MM, np.zeros(2)),
        Layer("line", "extended model", "extended", grid / MM, (lines["extended"] - lines["nominal"]) / BAR),
        Layer("means", BINS, "plain", at, mean, error),
    ]
    return Picture(
        f"evidence-{cause.effect.replace('.', '-')}",
        f"Pressure against spool: {effect_name(cause.effect)}",
        axis("spool position", "mm"),
        [Panel(axis("steady load pressure", "bar"), top), Panel(axis("off nominal", "bar"), below)],
        CAPTIONS["pressure_curve"],
    )


def throttling(material: Material, cause: NamedCause) -> Picture:
    """Flow for the opening, in parts of what it would be without load, against the load pressure against it: (4.22)."""
    seen = Pressures(material)
    gain, T = extended_pair(material, cause)
    free = gain * opening(material, seen.spool, cause)
    wide = np.abs(seen.spool) > OPEN * np.abs(seen.spool).max()
    x = np.sign(seen.spool[wide]) * seen.pressure[wide]
    y = (seen.pressure + T * seen.rate)[wide] / free[wide]
    grid = np.linspace(x.min(), x.max(), 201)
    law = np.sqrt(np.maximum(1.0 - material.value("continuity.c_q") * grid, 0.0))
    at, mean, error = binned(x / BAR, y, seen.independent)
    layers = [
        Layer("points", "measured", "measured", x / BAR, y),
        Layer("line", "nominal model", "nominal", grid[[0, -1]] / BAR, np.ones(2)),
        Layer("line", "extended model", "extended", grid / BAR, law),
        Layer("means", BINS, "plain", at, mean, error),
    ]
    return Picture(
        f"evidence-{cause.effect.replace('.', '-')}",
        "Flow for the opening against the load pressure",
        axis("load pressure against the flow", "bar"),
        [Panel("flow, in parts of that without load", layers)],
        CAPTIONS["throttling"],
    )


def lag(material: Material, cause: NamedCause) -> Picture:
    """Pressure still to come, K_c x - P, against the pressure's rate: the slope is the time constant."""
    seen = Pressures(material)
    gain, nominal = extended_pair(material, cause)
    _, extended = extended_pair(material, None)
    falls = material.value("continuity.r_T")
    told = f"T = {extended:.3g} s" if falls == 1.0 else f"T = {extended:.3g} and {falls * extended:.3g} s"
    x, y = seen.rate / BAR, (gain * opening(material, seen.spool, cause) - seen.pressure) / BAR
    at, mean, error = binned(x, y, seen.independent)
    ends = np.array([x.min(), 0.0, x.max()])
    both = np.array([falls, 1.0, 1.0])
    layers = [
        Layer("points", "measured", "measured", x, y),
        Layer("line", f"nominal model, T = {nominal:.3g} s", "nominal", ends, nominal * ends),
        Layer("line", f"extended model, {told}", "extended", ends, extended * both * ends),
        Layer("means", BINS, "plain", at, mean, error),
    ]
    return Picture(
        f"evidence-{cause.effect.replace('.', '-')}",
        "Pressure still to come against the pressure's rate",
        axis("rate of the load pressure", "bar/s"),
        [Panel(axis("steady pressure less pressure", "bar"), layers)],
        CAPTIONS["lag" if falls == 1.0 else "lags"],
    )


def supply(material: Material, cause: NamedCause) -> Picture:
    """Supply pressure against the (lagged) opening, (4.17): sag.

    Raises:
        LookupError: the supply pressure was not measured.
    """
    from scipy.signal import lfilter

    if "p_supply" not in material.measured or "spool" not in material.measured:
        raise LookupError("the supply needs p_supply and spool")
    if "k_s" not in cause.parameters:
        raise LookupError("the supply of the physical hydraulics falls with the flow, not with the opening")
    h = material.h
    p_s = material.value("continuity.p_s")
    decay = np.exp(-h / material.size(cause, "tau_s"))
    drawn = lfilter(
        [1.0 - decay], [1.0, -decay], np.abs(material.smooth(material.measured["spool"], PRESSURE_CUTOFF))
    )
    pick = points(material, 0.01)
    x, y = drawn[pick] / MM, material.smooth(material.measured["p_supply"], PRESSURE_CUTOFF)[pick] / BAR
    grid = np.linspace(0.0, drawn[pick].max(), 201)
    fall = material.size(cause, "k_s") * grid
    root = (np.sqrt(fall**2 + 4.0 * p_s**2) - fall) / (2.0 * p_s)  # of Ps = p_s - k_s x sqrt(Ps/p_s)
    at, mean, error = binned(x, y, 2.0 * PRESSURE_CUTOFF * 0.01)
    layers = [
        Layer("points", "measured", "measured", x, y),
        Layer("line", "nominal model", "nominal", grid[[0, -1]] / MM, np.full(2, p_s / BAR)),
        Layer("line", "extended model", "extended", grid / MM, p_s * root**2 / BAR),
        Layer("means", BINS, "plain", at, mean, error),
    ]
    return Picture(
        "evidence-continuity-supply_sag",
        "Supply pressure against the opening",
        axis("spool opening, lagged as the supply", "mm"),
        [Panel(axis("supply pressure", "bar"), layers)],
        CAPTIONS["supply"],
    )
