"""Chapter 5: the models alone, and their open-loop simulation against measured responses."""

from collections.abc import Callable
from functools import partial

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import curve_fit

from cosim.beside.tracker import run_tracker
from cosim.compare.metrics import fit_percent, rms
from cosim.identify.experiment import REST
from cosim.identify.state_space import root_locus
from cosim.plots import thinned
from cosim.report.picture import Layer, Panel, Picture, Role
from cosim.reproduce import models
from cosim.reproduce.campaign import AMPLITUDES, DEG, MISFIT, STEPS, VALIDATION, Campaign, step_of
from cosim.reproduce.chapter4 import line, trend
from cosim.reproduce.item import Item, Row

Array = NDArray[np.float64]

SHAPES = ("sine", "square")
UNITS = {"spool": ("mm", 1e3), "p_load": ("bar", 1e-5), "slew": ("deg", 1.0 / DEG)}
FAMILY: tuple[Role, ...] = ("nominal", "extended", "rising", "falling", "noise", "plain", "measured")


def makers(of: Campaign) -> dict[str, Callable[[], Item]]:
    """Chapter 5 in the source's order: number in the source -> what makes it."""
    return {
        "Figs 5.1b, 5.4b, 5.5": alone,
        "Fig. 5.2, (5.2)": locus,
        "Fig. 5.3": partial(simplified_against, of),
        "Fig. 5.6": partial(families, of),
        "Figs 5.7-5.10, 5.12": partial(blocks_against, of),
        "Figs 5.13-5.15": partial(both_against, of),
        "Fig. 5.16": partial(seam, of),
    }


def alone() -> Item:
    """Figs 5.1b, 5.4b and 5.5."""
    bode = models.bode(
        "bode",
        "Bode plots of the models",
        {
            "simplified (4.15)": (models.simplified(), "nominal"),
            "full order (5.12)": (models.full_order(), "extended"),
            "valve (5.3), mm": (models.valve(), "rising"),
            "pressure (5.4), bar/mm": (models.pressure(), "falling"),
        },
        0.1,
        100.0,
        "The two models of the whole drive in degrees per unit command; valve and pressure in their own units.",
    )
    chain = models.valve() * models.pressure() * models.mechanics()
    poles = models.pole_map(
        "poles",
        "Poles of the models",
        {"simplified (4.15)": (models.simplified(), "nominal"), "full order, by blocks": (chain, "extended")},
        "The pair is the valve's; -9.09 the pressure's, -34.9 the mechanics'; both models have one at 0.",
    )
    printed = np.asarray(models.PRINTED[1])
    ours = np.polymul(
        np.polymul([1.0, 2.0 * models.ZETA * models.W0, models.W0**2], [1.0, 1.0 / models.T]),
        [1.0, models.POLE],
    )
    gain = models.VALVE_GAIN * models.W0**2 * models.K_PRESSURE / models.T * models.AREA_ARM * models.GAIN
    rows = [Row(f"(5.12): coefficient of s^{4 - k}", float(printed[k]), float(ours[k])) for k in range(1, 5)]
    rows.append(Row("(5.12): numerator", models.PRINTED[0][0], float(gain)))
    apart = float(models.decibels(np.asarray(models.simplified()(5j)) / np.asarray(models.full_order()(5j))))
    verdict = (
        "The product of the blocks has every printed digit of (5.12), with 34.9 and 7.5e-6 in the mechanics "
        "(contradiction 1). "
        f"(4.15) is {-apart:.1f} dB below (5.12) at 5 rad/s and falls by 40 dB a decade, (5.12) by 100. Which panel of "
        "the source shows which block is not told apart here."
    )
    return Item(
        "alone",
        "Figs 5.1b, 5.4b, 5.5",
        "Bode plots and poles of the models alone",
        "From (4.15), (5.3), (5.4) and (5.12).",
        verdict,
        rows,
        [bode, poles],
        synthetic=False,
    )


def locus() -> Item:
    """Fig. 5.2."""
    loops = {
        "simplified (4.15)": root_locus([10.0], [1.0, 4.4, 0.0]),
        "full order (5.12)": root_locus(list(models.PRINTED[0]), list(models.PRINTED[1])),
    }
    layers = list[Layer]()
    roles: tuple[Role, ...] = ("nominal", "extended")
    for (name, found), role in zip(loops.items(), roles, strict=True):
        layers += [Layer("line", name, role, branch.real, branch.imag) for branch in found.poles.T]
    full = loops["full order (5.12)"]
    picture = Picture(
        "f52",
        "Poles of the loop as the proportional gain rises",
        "real part [1/s]",
        [Panel("imaginary part [1/s]", layers)],
        "Each branch begins at a pole of the drive; two of the full order's cross the axis.",
    )
    rows = [
        Row("gain limit, full order", 6.345, full.limit, "1/deg"),
        Row("phase margin at 1 per deg, full order", None, full.margins[1], "deg"),
        Row("phase margin at 1 per deg, simplified", None, loops["simplified (4.15)"].margins[1], "deg"),
    ]
    return Item(
        "locus",
        "Fig. 5.2, (5.2)",
        "Root locus of the position loop",
        "By python-control.",
        (
            "The full order is unstable beyond the source's gain; the simplified model never is, which says what it "
            "leaves out."
        ),
        rows,
        [picture],
        synthetic=False,
    )


def overlay(
    of: Campaign, key: str, title: str, name: str, wanted: tuple[str, ...], which: tuple[str, ...]
) -> Picture:
    """Measured signals of a log, and those of the models, each with the models' errors below.

    Args:
        of: the logs.
        key: of the picture.
        title: of the picture.
        name: of the log.
        wanted: signals.
        which: models.
    """
    log, panels = of.log(name), list[Panel]()
    roles: dict[str, Role] = {"simplified": "nominal", "full_order": "extended"}
    for signal in wanted:
        unit, scale = UNITS[signal]
        measured = scale * signal_of(log, signal)
        layers, errors = [line("measured (rig)", "measured", log.time, measured)], list[Layer]()
        for model in which:
            made = scale * of.signals(model, name)[signal][: measured.size]
            text = model.replace("_", " ")
            layers.append(line(text, roles[model], log.time, made))
            errors.append(line(text, roles[model], log.time, measured - made))
        panels += [Panel(f"{signal.replace('_', ' ')} [{unit}]", layers), Panel(f"error [{unit}]", errors)]
    return Picture(
        key,
        title,
        "time [s]",
        panels,
        "Open loop: the models see the command alone. Errors are measured less simulated.",
    )


def signal_of(log: object, signal: str) -> Array:
    """A signal of a log, the load pressure included, SI."""
    return np.asarray(log[signal])  # type: ignore[index]


def best(of: Campaign, model: str, name: str, signal: str) -> float:
    """Best fit % of a model's signal on a log."""
    measured = signal_of(of.log(name), signal)
    found = fit_percent(measured, of.signals(model, name)[signal][: measured.size])
    return float("nan") if found is None else found


def simplified_against(of: Campaign) -> Item:
    """Fig. 5.3."""
    rows = [
        Row(
            f"best fit of the slew, {shape} {100 * level:g} %",
            None,
            best(of, "simplified", f"{shape} {level:g}", "slew"),
            "%",
        )
        for shape in SHAPES
        for level in AMPLITUDES
    ]
    pictures = [
        overlay(of, f"f53{s}", f"Simplified model, {s} at 75 %", f"{s} 0.75", ("slew",), ("simplified",))
        for s in SHAPES
    ]
    least, most = min(rows, key=lambda r: r.ours), max(rows, key=lambda r: r.ours)
    verdict = (
        f"The simplified model follows the slew with best fits from {least.ours:.1f} % "
        f"({least.name.partition(', ')[2]}) to {most.ours:.1f} % "
        f"({most.name.partition(', ')[2]}). The source shows the same overlays and prints no fit for them."
    )
    return Item(
        "simplified",
        "Fig. 5.3",
        "Simplified model against the measured slew",
        "Open loop, through the FMUs, six frequencies at 100, 75 and 35 %.",
        verdict,
        rows,
        pictures,
    )


def families(of: Campaign) -> Item:
    """Fig. 5.6."""
    log, made = of.log("steps"), of.signals("full_order", "steps")["spool"]
    layers, rows = list[Layer](), list[Row]()
    for level, role in zip(STEPS, FAMILY, strict=True):
        part = step_of(level)
        time = log.time[part] - log.time[part][0]
        found = second_order(time, log["spool"][part])
        layers.append(
            line(
                f"{100 * level:g} % (rig)",
                role,
                1e3 * time,
                log["spool"][part] / found[0],
                hidden=level < 0.1,
            )
        )
        rows.append(Row(f"damping ratio at {100 * level:g} %", models.ZETA, found[2], "1", found[3]))
    part = step_of(0.5)
    time = (log.time[part] - log.time[part][0]) * 1e3
    layers.append(line("model (5.3), every size", "plain", time, made[part] / float(made[part][-1])))
    picture = Picture(
        "f56",
        "Steps of the valve, over their final value",
        "time [ms]",
        [Panel("spool / final value", layers)],
        "A linear valve would give one curve.",
    )
    large, small = rows[0], rows[STEPS.index(0.2)]
    damped = trend(Row("", None, models.ZETA), large) == "rises" and trend(large, small) == "rises"
    verdict = (
        f"A second order fitted to each step has a damping ratio of {large.ours:.2f} at 100 %, {rows[3].ours:.2f} at "
        f"35 % and {small.ours:.2f} at "
        f"20 %; (5.3) has 0.545 at every size. "
        + (
            "More damped than the model, above all at small amplitudes: the source's own finding. The diagnosis "
            "names it dcv.amplitude_damping."
            if damped
            else "The source finds its valve more damped than the model, above all at small amplitudes; this log does "
            "not show that."
        )
    )
    return Item(
        "families",
        "Fig. 5.6",
        "Step responses of the valve by amplitude",
        "Steps from 0 to 100, 75, 50, 35, 20, 10 and 5 %; the source's number is (5.3)'s.",
        verdict,
        rows,
        [picture],
    )


def second_order(time: Array, spool: Array) -> tuple[float, float, float, float]:
    """Final value [m], natural frequency [rad/s] and damping ratio fitted to a step, and half the ratio's 95 % interval.

    Raises:
        RuntimeError: the fit does not end, as for a log without a step.
    """

    def response(t: Array, final: float, w0: float, zeta: float) -> Array:
        root = np.emath.sqrt(zeta**2 - 1.0 + 1e-12)
        fast, slow = w0 * (-zeta - root), w0 * (-zeta + root)
        shape = 1.0 + (fast * np.exp(slow * t) - slow * np.exp(fast * t)) / (slow - fast)
        return np.asarray(final * shape.real)

    begin = (float(np.mean(spool[-100:])), models.W0, 0.7)
    found, covariance = curve_fit(
        response,
        time,
        spool,
        begin,
        bounds=([-np.inf, 5.0, 0.05], [np.inf, 200.0, 5.0]),
        x_scale=np.abs(begin),
    )
    return float(found[0]), float(found[1]), float(found[2]), 1.96 * float(np.sqrt(covariance[2, 2]))


def blocks_against(of: Campaign) -> Item:
    """Figs 5.7 to 5.10 and 5.12."""
    rows = [
        Row(
            f"best fit of the {'spool' if signal == 'spool' else 'load pressure'}, {shape} {100 * level:g} %",
            None,
            best(of, "full_order", f"{shape} {level:g}", signal),
            "%",
        )
        for signal in ("spool", "p_load")
        for shape in SHAPES
        for level in AMPLITUDES
    ]
    pictures = [
        overlay(
            of,
            f"f57{s}{level:g}".replace(".", ""),
            f"Valve and pressure, {s} at {100 * level:g} %",
            f"{s} {level:g}",
            ("spool", "p_load"),
            ("full_order",),
        )
        for s in SHAPES
        for level in (1.0, 0.35)
    ]
    large, small = rows[0].ours, rows[2].ours
    verdict = (
        f"Best fit of the spool to a sine: {large:.1f} % at 100 %, {small:.1f} % at 35 %"
        + (
            ": the smaller the motion, the more of it the linear valve misses, as fig. 5.6 says. "
            if small < large - 1.0
            else ". "
        )
        + "The source prints fits of 77 to 85 % for its own records (Table 4.3)."
    )
    return Item(
        "blocks",
        "Figs 5.7-5.10, 5.12",
        "Valve and load pressure against the model",
        "Open loop, through the FMUs.",
        verdict,
        rows,
        pictures,
    )


def both_against(of: Campaign) -> Item:
    """Figs 5.13 to 5.15."""
    rows = [
        Row(
            f"best fit of the slew, {model.replace('_', ' ')}, {shape} 75 %",
            None,
            best(of, model, f"{shape} 0.75", "slew"),
            "%",
        )
        for model in ("simplified", "full_order")
        for shape in SHAPES
    ]
    errors = {model: errors_by_frequency(of, model) for model in ("simplified", "full_order")}
    for k, w in enumerate(VALIDATION):
        rows += [
            Row(f"error at {w:g} rad/s, {model.replace('_', ' ')}", None, of_[k], "% of the slew's size")
            for model, of_ in errors.items()
        ]
    pictures = [
        overlay(
            of, f"f513{s}", f"Both models, {s} at 75 %", f"{s} 0.75", ("slew",), ("simplified", "full_order")
        )
        for s in SHAPES
    ]
    pictures.append(
        Picture(
            "f515",
            "Error of both models by frequency, sine at 75 %",
            "frequency [rad/s]",
            [
                Panel(
                    "error [% of the slew's size]",
                    [
                        Layer(
                            "line",
                            "simplified",
                            "nominal",
                            np.array(VALIDATION),
                            np.array(errors["simplified"]),
                        ),
                        Layer(
                            "line",
                            "full order",
                            "extended",
                            np.array(VALIDATION),
                            np.array(errors["full_order"]),
                        ),
                    ],
                )
            ],
            "Of each period, its mean taken off; the first periods carry what the start leaves.",
            log=True,
        )
    )
    nearer = [
        w for w, s, f in zip(VALIDATION, errors["simplified"], errors["full_order"], strict=True) if f < s
    ]
    fast = VALIDATION[-1] in nearer and VALIDATION[-2] in nearer
    verdict = (
        f"At {VALIDATION[0]:g} rad/s the models err by {errors['simplified'][0]:.1f} % (simplified) and "
        f"{errors['full_order'][0]:.1f} % (full "
        f"order) of the slew, at {VALIDATION[-1]:g} rad/s by {errors['simplified'][-1]:.0f} % and "
        f"{errors['full_order'][-1]:.0f} %. "
        + (
            "The full order is the nearer one from "
            f"{min(w for w in nearer if all(v in nearer for v in VALIDATION if v >= w)):g} rad/s on: both "
            "serve at low frequency and the full order is the better one at high frequency, as the source finds."
            if fast
            else "The source finds the full order better at high frequency; this log does not show that."
        )
    )
    return Item(
        "both",
        "Figs 5.13-5.15",
        "Simplified, full order and measured, with their errors",
        "One period each of 0.5 to 16 rad/s at 75 %, as sines and as square waves; open loop, through the FMUs.",
        verdict,
        rows,
        pictures,
    )


def errors_by_frequency(of: Campaign, model: str) -> list[float]:
    """RMS error of the slew over its own RMS [%] in each period of the sine at 75 %, means taken off."""
    log = of.log("sine 0.75")
    measured, made = log["slew"], of.signals(model, "sine 0.75")["slew"]
    start, found = REST, []
    for w in VALIDATION:
        end = start + 2.0 * np.pi / w
        part = slice(round(start * 1e3), round(end * 1e3))
        error = measured[part] - made[part]
        found.append(100.0 * rms(error - error.mean()) / rms(measured[part] - measured[part].mean()))
        start = end
    return found


def seam(of: Campaign) -> Item:
    """Fig. 5.16."""
    import tempfile
    from pathlib import Path

    from cosim.markers import seam as of_models
    from cosim.rig.write import write_tracker

    run = of.run("tracker")
    if run.markers is None:
        raise ValueError("the tracker's log is made with marker positions")
    by_models = of_models(*run.markers.models) / DEG
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder, "tracker.csv")
        write_tracker(run, file)
        found = run_tracker(of.log("tracker"), file)
    difference, angle = found.difference / DEG, found.reading / DEG
    x, y = thinned(angle, difference)
    picture = Picture(
        "f516",
        "Slew sensor minus tracker, clocks laid over each other",
        "time [s]",
        [
            Panel(
                "slew [deg]",
                [
                    line("slew sensor (rig)", "extended", found.time, found.sensor / DEG),
                    line("tracker (rig)", "nominal", found.time, angle),
                ],
            ),
            Panel(
                "difference [deg]",
                [
                    line("slew sensor - tracker", "measured", found.time, difference),
                    line("errors taken out", "rising", found.time, -found.corrected / DEG),
                ],
            ),
        ],
        "Below 12 deg the tracker uses its first marker model.",
    )
    over = Picture(
        "f516b",
        "The same difference over the angle",
        "tracker [deg]",
        [Panel("difference [deg]", [Layer("points", "slew sensor - tracker", "measured", x, y)])],
        "The step lies where the two marker models meet.",
    )
    rows = []
    if found.finding.seam_angle is not None:
        best_at, low, high = (a / DEG for a in found.finding.seam_angle)
        rows.append(Row("angle of the step", 12.0, best_at, "deg", 0.5 * (high - low)))
    value, deviation = (
        found.finding.fit.values.get("tracker.seam", 0.0),
        found.finding.fit.deviations.get("tracker.seam", float("nan")),
    )
    rows.append(Row("height of the step, in the record", None, value / DEG, "deg", 1.96 * deviation / DEG))
    rows.append(Row("height of the step, by the marker models", None, by_models, "deg"))
    same = "is" if abs(value / DEG - by_models) <= 1.96 * deviation / DEG else "is not quite"
    verdict = (
        "The difference steps where the two marker models meet, in every pass, as in the source; the step of the record "
        f"{same} what the models differ by. The tracker's clock is found from the records themselves, which the source did "
        "by hand."
    )
    return Item(
        "seam",
        "Fig. 5.16",
        "Slew sensor against the external tracker",
        "Poses from marker positions at 80 Hz, by two marker models laid on each other with errors of "
        f"{1e3 * MISFIT:g} mm; a clock offset is hidden.",
        verdict,
        rows,
        [picture, over],
    )
