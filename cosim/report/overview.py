"""Pictures of the whole: signals before and after, shares of the blocks, residuals with their noise."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from cosim.diagnosis.answer.remarks import shown
from cosim.diagnosis.answer.schema import Answer
from cosim.diagnosis.record.grid import window_span
from cosim.diagnosis.residuals.cross_validation import held_windows
from cosim.report.material import BLOCK_EXTENDED, BLOCK_NOMINAL, EXTENDED, NOMINAL, Material, Noise, Part
from cosim.report.picture import Layer, Panel, Picture, Role
from cosim.report.series import MOST_BUCKETS, averaged, bucket, envelope
from cosim.report.words import CAPTIONS, at_start, axis, block_name, by_error, effect_name, signal_name

Array = NDArray[np.float64]

SAME = 0.05  # of an error: below this a change is that of the noise in the held-out windows
AROUND = 3.0  # s shown before and after an event, at least


def held_out(material: Material) -> list[tuple[float, float]]:
    """Spans of time, s, that were not used for fitting."""
    start = material.answer.held_out_from
    if start is not None:
        return [(start, float(material.time[-1]))] if start < material.time[-1] else []
    size = window(material)
    span, count = size * material.h, len(material.time) // size
    return [(k * span, (k + 1) * span) for k in np.flatnonzero(held_windows(count)).tolist()]


def window(material: Material) -> int:
    """Samples in a window of which every third is held out: those of the fits, shorter in a short log."""
    for part in material.parts.values():
        for noise in part.noise.values():
            return noise.bins * noise.window
    return round(window_span(material.h) / material.h)


def nothing_to_extend(answer: Answer) -> bool:
    """Whether the extended model is the nominal one: nothing was named, and no parameter fitted that changes an error."""
    return (
        answer.verdict == "adequate"
        and not answer.causes
        and bool(answer.gain)
        and all(abs(g.rmse_after - g.rmse_before) <= SAME * g.rmse_before for g in answer.gain.values())
    )


def signals(material: Material) -> list[Picture]:
    """Measured against simulated, from the command alone, one picture a signal, the one most in error first."""
    return [_signal(material, signal, held_out(material)) for signal in seen(material)]


def seen(material: Material) -> list[str]:
    """Signals that were measured and simulated, the one most in error first."""
    return by_error(material.answer, [s for s in material.series[NOMINAL] if s in material.measured])


def held_signals(material: Material) -> list[Picture]:
    """The same for a held-out log, which is what the gains are measured on."""
    if material.other is None:
        return []
    found = []
    for signal in seen(material.other):
        picture = _signal(material.other, signal, [])  # all of it was held out
        key, title = f"held-out-{picture.key}", f"{picture.title}: held-out data"
        found.append(replace(picture, key=key, title=title))
    return found


def _signal(material: Material, signal: str, held: list[tuple[float, float]]) -> Picture:
    unit, scale = shown(signal)
    size = bucket(material.time.size, material.h)
    measured = material.measured[signal] * scale
    at, values = envelope(measured, size)
    top = [Layer("line", "measured", "measured", material.at(at), values)]
    spans, errors = [], []
    item = material.answer.signals.get(signal)
    if item is not None and item.noise_floor > 0.0:
        ends = np.array([0.0, material.time[-1]])
        band = np.full(2, 2.0 * item.noise_floor)
        spans.append(Layer("band", "sensor noise, ±2 sd", "noise", ends, -band, band))
    for name, role, kind in (("nominal model", "nominal", NOMINAL), ("extended model", "extended", EXTENDED)):
        simulated = material.series[kind].get(signal)
        if simulated is None or (kind == EXTENDED and nothing_to_extend(material.answer)):
            continue
        middle, mean = averaged(simulated * scale, size)
        top.append(Layer("line", name, role, material.at(middle), mean))  # type: ignore[arg-type]
        error = measured - simulated * scale
        _, peaks = envelope(error, size)
        low, high = np.sort(peaks[: 2 * middle.size].reshape(-1, 2), axis=1).T if size > 1 else (error, error)
        spans.append(Layer("band", "", role, material.at(middle), low, high))  # type: ignore[arg-type]
        errors.append(Layer("line", name, role, material.at(middle), averaged(error, size)[1]))  # type: ignore[arg-type]
    caption = CAPTIONS["signal"].format(bucket=1e3 * size * material.h)
    caption += f" {CAPTIONS['shaded']}" if held else ""
    return Picture(
        f"signal-{signal}",
        f"{at_start(signal_name(signal))}, driven by the command alone",
        axis("time", "s"),
        [Panel(axis(signal_name(signal), unit), top), Panel(axis("error", unit), spans + errors)],
        caption,
        held,
    )


def shares(material: Material) -> Picture:
    """How the systematic part of the residual is divided between the blocks."""
    rows = sorted(material.answer.localisation, key=lambda r: -r.share)
    labels = tuple(f"{block_name(r.block)}: {signal_name(r.signal)}" for r in rows)
    x = np.arange(len(rows), dtype=np.float64)
    ratio = np.array([r.residual_rms / r.noise_floor if r.noise_floor > 0.0 else 0.0 for r in rows])
    return Picture(
        "localisation",
        "Where it goes wrong",
        "",
        [
            Panel(
                "share [%]",
                [Layer("bars", "share", "extended", x, np.array([100.0 * r.share for r in rows]))],
            ),
            Panel(
                "residual / noise [1]", [Layer("bars", "residual RMS over its noise", "measured", x, ratio)]
            ),
        ],
        CAPTIONS["shares"],
        labels=labels,
    )


def judged(residual: Array, noise: Noise) -> tuple[Array, Array]:
    """Positions in samples and values of a residual as it is judged: averaged, free offsets of windows taken out.

    NaN stands between windows that have offsets of their own, so that no line joins them.
    """
    at, values = averaged(residual, noise.bins)
    if not noise.free:
        return at, values
    count = values.size // noise.window
    rows = values[: count * noise.window].reshape(count, noise.window)
    rows = rows - rows.mean(axis=1, keepdims=True)
    places = at[: count * noise.window].reshape(count, noise.window)
    gap = np.full((count, 1), np.nan)
    return np.hstack([places, places[:, -1:]]).ravel(), np.hstack([rows, gap]).ravel()


def residuals(material: Material) -> list[Picture]:
    """Residual of each block as it was judged, nominal and extended, with its noise band."""
    parts = material.parts.values()
    return [_residual(material, part, signal) for part in parts for signal in part.noise]


def event(material: Material, block: str, what: str, span: tuple[float, float], key: str) -> list[Picture]:
    """The residual of a block around the stretch, s, in which alone something is off."""
    part = material.parts.get(block)
    signal = next((s for s in part.noise if s in what), None) if part is not None else None
    if part is None or signal is None:
        return []
    around = max(AROUND, span[1] - span[0])
    whole = _residual(material, part, signal)
    (panel,) = whole.panels
    near = (max(0.0, span[0] - around), min(float(material.time[-1]), span[1] + around))
    layers = [cut(layer, near) for layer in panel.layers]
    title = f"{whole.title} between {span[0]:.1f} and {span[1]:.1f} s"
    return [
        replace(
            whole,
            key=key,
            title=title,
            panels=[replace(panel, layers=layers)],
            shaded=[span],
            caption=CAPTIONS["event"],
        )
    ]


def cut(layer: Layer, span: tuple[float, float]) -> Layer:
    """The part of a layer within a span of its abscissa; a band, which is the same everywhere, from end to end."""
    if layer.kind == "band":
        return replace(layer, x=np.array(span))
    kept = ~((layer.x < span[0]) | (layer.x > span[1]))  # breaks of the line stay
    return replace(layer, x=layer.x[kept], y=layer.y[kept])


def _residual(material: Material, part: Part, signal: str) -> Picture:
    noise = part.noise[signal]
    unit, scale = shown(signal)
    band = np.full(2, 2.0 * noise.rms * scale)
    ends = np.array([0.0, material.time[-1]])
    layers = [Layer("band", "its noise, ±2 sd", "noise", ends, -band, band)]
    shown_series: list[tuple[str, Role, Array, bool]] = [
        ("nominal model", "nominal", material.series[BLOCK_NOMINAL][signal], False),
        ("extended model", "extended", material.series[BLOCK_EXTENDED][signal], False),
    ]
    for cause in material.answer.causes:
        without = material.without(cause, signal)
        if without is not None:
            shown_series.append((f"without {effect_name(cause.effect)}", "falling", without, True))
    for name, role, simulated, hidden in shown_series:
        at, values = judged(material.measured[signal] - simulated, noise)
        if at.size > 2 * MOST_BUCKETS:
            kept, values = envelope(values, -(-at.size // MOST_BUCKETS))
            at = at[kept.astype(int)]
        layers.append(Layer("line", name, role, material.at(at), values * scale, hidden=hidden))
    block = block_name(part.name)
    caption = CAPTIONS["block_free" if noise.free else "block"].format(
        block=block.capitalize(),
        drive=signal_name(part.drive),
        bin=1e3 * noise.bins * material.h,
        window=noise.bins * noise.window * material.h,
    )
    title = f"{block.capitalize()}: residual of the {signal_name(signal)}"
    panel = Panel(axis("residual", unit), layers)
    key = f"residual-{part.name}-{signal}"
    return Picture(key, title, axis("time", "s"), [panel], caption, held_out(material))


def tracker(material: Material) -> Picture | None:
    """Slew sensor and external tracker, on the log's clock; None without a tracker."""
    if not material.tracker or "slew" not in material.measured:
        return None
    time, reading = material.tracker["time"], material.tracker["reading"]
    slew = np.interp(time, material.time, material.measured["slew"])
    unit, scale = shown("slew")
    top = [
        Layer("line", "slew sensor", "measured", time, slew * scale),
        Layer("line", "tracker", "rising", time, reading * scale),
    ]
    off = Layer("line", "slew sensor less tracker", "plain", time, (slew - reading) * scale)
    return Picture(
        "tracker",
        "Slew sensor and external tracker",
        axis("time on the log's clock", "s"),
        [Panel(axis("slew angle", unit), top), Panel(axis("difference", unit), [off])],
        CAPTIONS["tracker"],
    )
