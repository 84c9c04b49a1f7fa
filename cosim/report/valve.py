"""Evidence in the valve: what the measured spool says about the demand it was given, and its steps."""

import numpy as np
from numpy.typing import NDArray

from cosim.diagnosis.answer.schema import NamedCause
from cosim.report.material import BLOCK_EXTENDED, Material
from cosim.report.picture import Layer, Panel, Picture
from cosim.report.series import binned, steady, steps_of
from cosim.report.torque import points
from cosim.report.words import CAPTIONS, at_start, axis, effect_name, signal_name

Array = NDArray[np.float64]

SPOOL_CUTOFF = 15.0  # Hz, beyond the valve's bandwidth of some 4 Hz
MM = 1e-3
BEFORE, AFTER = 0.05, 0.6  # s shown around a step
OVERLAID = 20  # steps laid over each other


def demand_of(material: Material, cause: NamedCause) -> Array:
    """(n,) demand in m that the valve's linear part (4.16) needs for the measured spool, smoothed.

    Raises:
        LookupError: the spool was not measured.
    """
    if "spool" not in material.measured:
        raise LookupError("the valve needs the spool")
    w0, zeta = material.value("dcv.w0", cause), material.value("dcv.zeta", cause)
    spool = material.smooth(material.measured["spool"], SPOOL_CUTOFF)
    rate, acceleration = material.slopes(spool)
    return spool + 2.0 * zeta / w0 * rate + acceleration / w0**2


def static(material: Material, u: Array, but: NamedCause | None) -> Array:
    """Demand in m at rest for each command in u (k,), by the blocks' own equations, without cause `but`."""
    from fmus import dead_zone

    def form(component: str, number: float, limit: float) -> dead_zone.Parameters:
        known = {"form": number, "limit": limit}
        names = dead_zone.Parameters._fields
        return dead_zone.Parameters(
            *(known[n] if n in known else material.value(f"{component}.{n}", but) for n in names)
        )

    compensator, zone = form("compensator", 3.0, 2.0), form("dead_zone", 1.0, 1.0)
    demand = np.array([dead_zone.limited(dead_zone.limited(float(x), compensator), zone) for x in u])
    demand = demand * material.value("dcv.K", but) + material.value("dcv.x_0", but)
    return np.clip(demand, material.value("dcv.x_min", but), material.value("dcv.x_max", but))


def curve(material: Material, cause: NamedCause) -> Picture:
    """Demand that the spool shows against the command: gain, offset, dead zone and stroke."""
    demand, h = demand_of(material, cause), material.h
    u = material.measured["u"]
    pick = points(material, 0.01)
    pick = pick[steady(u, h)[pick]]
    if pick.size < 20:
        raise LookupError("the command jumps all the time")
    x, y = u[pick], demand[pick]
    off = (demand - material.smooth(static(material, u, cause), SPOOL_CUTOFF))[pick]
    grid = np.unique(np.concatenate([np.linspace(x.min(), x.max(), 401), np.linspace(-0.12, 0.12, 241)]))
    grid = grid[(grid >= x.min()) & (grid <= x.max())]
    nominal, extended = static(material, grid, cause), static(material, grid, None)
    at, mean, error = binned(x, off / MM, 2.0 * SPOOL_CUTOFF * 0.01, 40)
    top = [
        Layer("points", "measured", "measured", 100.0 * x, y / MM),
        Layer("line", "nominal model", "nominal", 100.0 * grid, nominal / MM),
        Layer("line", "extended model", "extended", 100.0 * grid, extended / MM),
    ]
    below = [
        Layer("points", "measured", "measured", 100.0 * x, off / MM),
        Layer("line", "nominal model", "nominal", 100.0 * grid[[0, -1]], np.zeros(2)),
        Layer("line", "extended model", "extended", 100.0 * grid, (extended - nominal) / MM),
        Layer("means", "mean in bins, ±2 standard errors", "plain", 100.0 * at, mean, error),
    ]
    return Picture(
        f"evidence-{cause.effect.replace('.', '-')}",
        f"Valve curve: {effect_name(cause.effect)}",
        axis("command u", "%"),
        [Panel(axis("spool demand", "mm"), top), Panel(axis("off nominal", "mm"), below)],
        CAPTIONS["curve"],
    )


def play(material: Material, cause: NamedCause) -> Picture:
    """Demand off its nominal value against the command, rising and falling: hysteresis opens a loop."""
    demand, h = demand_of(material, cause), material.h
    u = material.measured["u"]
    half = material.size(cause, "play")
    pick = points(material, 0.01)
    pick = pick[steady(u, h)[pick]]
    change = np.diff(u, prepend=u[:1])
    moved = np.where(np.abs(change) > 1e-9, np.arange(u.size), 0)
    direction = np.sign(change)[np.maximum.accumulate(moved)]
    turned = np.maximum.accumulate(np.where(np.diff(direction, prepend=0.0) != 0.0, np.arange(u.size), 0))
    # just after a reversal the play is being crossed: on neither side of the loop
    crossed = np.abs(u - u[np.maximum(turned - 1, 0)]) > 2.0 * half + 0.01
    pick = pick[crossed[pick]]
    off = (demand - material.smooth(static(material, u, cause), SPOOL_CUTOFF)) / material.value(
        "dcv.K", cause
    )
    layers = []
    for name, role, sign in (("command rising", "rising", 1.0), ("command falling", "falling", -1.0)):
        own = direction[pick] == sign
        if not own.any():
            continue
        x, y = 100.0 * u[pick][own], 100.0 * off[pick][own]
        at, mean, error = binned(x, y, 2.0 * SPOOL_CUTOFF * 0.01)
        layers.append(Layer("points", name, role, x, y))  # type: ignore[arg-type]
        layers.append(Layer("means", f"mean, {name}", role, at, mean, error))  # type: ignore[arg-type]
    ends = 100.0 * np.array([u.min(), u.max()])
    layers.append(Layer("line", "nominal model", "nominal", ends, np.zeros(2)))
    name = "extended model: the play's half-width"
    layers += [Layer("line", name, "extended", ends, np.full(2, 100.0 * sign * half)) for sign in (-1.0, 1.0)]
    return Picture(
        "evidence-dcv-hysteresis",
        "Demand behind the command, rising and falling",
        axis("command u", "%"),
        [Panel(axis("demand off nominal", "%"), layers)],
        CAPTIONS["play"],
    )


def span_of(material: Material, apart: Array) -> tuple[NDArray[np.intp], Array, str, str]:
    """Where to look at a response: samples (occurrences, k), abscissa (k,) in s, words for the title, label.

    The kind of step of the command at which two models are most `apart` (n,); without steps, where they are most apart.
    """
    h, u = material.h, material.measured["u"]
    a, b = round(BEFORE / h), round(AFTER / h)
    choices = []
    for pair, at in steps_of(u, h).items():
        inside = at[(at >= a) & (at + b <= u.size)][:OVERLAID]
        if inside.size:
            rows = inside[:, None] + np.arange(-a, b)
            choices.append((float(np.mean(apart[rows] ** 2) * np.sqrt(inside.size)), pair, rows))
    if not choices:
        centre = int(np.clip(np.argmax(material.smooth(apart**2, 1.0)), a + b, u.size - a - b - 1))
        rows = np.arange(max(0, centre - 2 * b), min(u.size, centre + 2 * b))[None, :]
        return rows, rows[0] * h, "where the two models differ most", axis("time", "s")
    _, pair, rows = max(choices, key=lambda c: c[0])
    still = np.all(np.abs(u[rows] - u[rows[:, a]][:, None]) < 1e-3, axis=0)
    moved = np.flatnonzero(~still[a:])
    rows = rows[:, : a + (int(moved[0]) if moved.size else b)]
    title = f"after steps of the command from {100 * pair[0]:.0f} to {100 * pair[1]:.0f} %"
    return rows, np.arange(-a, rows.shape[1] - a) * h, title, axis("time after the step", "s")


def step_response(material: Material, cause: NamedCause, signal: str = "spool") -> Picture:
    """Responses aligned on the command's steps: measured, without the cause, with it.

    Raises:
        LookupError: the predictions were not kept.
    """
    without, extended = material.without(cause, signal), material.series[BLOCK_EXTENDED].get(signal)
    if without is None or extended is None:
        raise LookupError(f"the predictions of {signal} were not kept")
    from cosim.diagnosis.answer.remarks import shown

    unit, scale = shown(signal)
    measured = material.measured[signal]
    rows, x, title, label = span_of(material, extended - without)
    title = f"{at_start(signal_name(signal))} {title}"
    count = rows.shape[0]
    means = {"measured": measured[rows], "nominal": without[rows], "extended": extended[rows]}
    names = {
        "measured": f"measured, mean of {count}" if count > 1 else "measured",
        "nominal": "without it",
        "extended": "with it",
    }
    thin = max(1, x.size // 1200)
    top, below = [], []
    for role, values in means.items():
        mean = values.mean(axis=0) * scale
        top.append(Layer("line", names[role], role, x[::thin], mean[::thin]))  # type: ignore[arg-type]
        off = (values - means["nominal"]).mean(axis=0) * scale
        below.append(Layer("line", names[role], role, x[::thin], off[::thin]))  # type: ignore[arg-type]
    return Picture(
        f"evidence-{cause.effect.replace('.', '-')}",
        title,
        label,
        [Panel(axis(signal_name(signal), unit), top), Panel(axis("off nominal", unit), below)],
        CAPTIONS["step_response"].format(effect=effect_name(cause.effect)),
    )


def ceiling(material: Material, cause: NamedCause) -> Picture:
    """Measured spool against the one predicted without stops: the stroke's ends.

    Raises:
        LookupError: the prediction was not kept.
    """
    free = material.without(cause, "spool")
    if free is None:
        raise LookupError("the prediction without stops was not kept")
    pick = points(material, 0.01)
    x = free[pick] / MM
    y = material.smooth(material.measured["spool"], 2.0 * SPOOL_CUTOFF)[pick] / MM
    grid = np.linspace(x.min(), x.max(), 401)
    low, high = (material.size(cause, name) / MM for name in ("x_min", "x_max"))
    layers = [
        Layer("points", "measured", "measured", x, y),
        Layer("line", "nominal model", "nominal", grid, grid),
        Layer("line", "extended model", "extended", grid, np.clip(grid, low, high)),
    ]
    return Picture(
        "evidence-dcv-stroke_limit",
        "Measured spool against the spool without stops",
        axis("spool position predicted without stops", "mm"),
        [Panel(axis("measured spool position", "mm"), layers)],
        CAPTIONS["ceiling"],
    )
