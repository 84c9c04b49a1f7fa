"""One picture for each named cause, by the kind of its effect; a plain one for an effect that has none of its own."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from cosim.diagnosis.answer.remarks import shown
from cosim.diagnosis.answer.schema import NamedCause
from cosim.report import hydraulics, reading, torque, valve
from cosim.report.material import BLOCK_EXTENDED, Curve, Material
from cosim.report.picture import Layer, Panel, Picture
from cosim.report.series import averaged, binned
from cosim.report.words import (
    CAPTIONS,
    CHANGING,
    at_start,
    axis,
    block_name,
    effect_name,
    lacking,
    quantity,
    signal_name,
)

Array = NDArray[np.float64]
Maker = Callable[[Material, NamedCause], Picture]


def _pressure_steps(material: Material, cause: NamedCause) -> Picture:
    return valve.step_response(material, cause, "p_load")


MAKERS: dict[str, tuple[Maker, ...]] = {
    "dead_zone.mismatch": (valve.curve,),
    "dcv.gain": (valve.curve,),
    "dcv.offset": (valve.curve,),
    "dcv.stroke_limit": (valve.ceiling, valve.step_response),
    "dcv.hysteresis": (valve.play,),
    "dcv.bandwidth": (valve.step_response,),
    "dcv.damping": (valve.step_response,),
    "dcv.amplitude_damping": (valve.step_response,),
    "dcv.delay": (valve.step_response,),
    "dcv.rate_limit": (valve.step_response,),
    "continuity.flow_gain": (hydraulics.pressure_curve,),
    "continuity.flow_asymmetry": (hydraulics.pressure_curve,),
    "continuity.leakage": (hydraulics.pressure_curve, _pressure_steps),
    "continuity.compressibility": (hydraulics.lag,),
    "continuity.lag_asymmetry": (hydraulics.lag,),
    "continuity.supply_sag": (hydraulics.supply,),
    "continuity.travel_flow": (_pressure_steps,),
    "continuity.flow_pressure": (hydraulics.throttling,),
    "continuity.cracking_pressure": (torque.over_pressure,),
    # of the physical hydraulics: what is left of pressure and supply, with and without it
    "continuity.tank_leak_a": (),
    "continuity.tank_leak_b": (),
    "continuity.supply_pressure": (),
    "mechanical.coulomb_friction": (torque.over_speed,),
    "mechanical.stribeck_friction": (torque.over_speed,),
    "mechanical.constant_load": (torque.over_speed,),
    "mechanical.coulomb_asymmetry": (torque.over_speed,),
    "mechanical.viscous_friction": (torque.over_speed,),
    "mechanical.viscous_asymmetry": (torque.over_speed,),
    "mechanical.inertia": (torque.over_acceleration,),
    "mechanical.gravity_load": (torque.over_angle,),
    "mechanical.gear_ripple": (torque.over_angle,),
    "mechanical.backlash": (torque.lost_motion,),
    "mechanical.compliance": (torque.spectrum,),
    "mechanical.end_stop": (reading.limit,),
    "simplified.end_stop": (reading.limit,),
    "sensor.saturation": (reading.limit,),
    "mechanical.linkage": (reading.speed_over_angle,),
    "sensor.bias": (reading.against_tracker,),
    "sensor.gain": (reading.sensor,),
    "sensor.drift": (reading.sensor,),
    "sensor.lag": (reading.against_model,),
    "sensor.quantisation": (reading.staircase,),
    "sensor.dropout": (reading.repeats,),
    "tracker.clock": (reading.against_tracker,),
    "tracker.seam": (reading.against_tracker,),
}


def pictures(material: Material, cause: NamedCause) -> list[Picture]:
    """The evidence for a named cause, from the data; the plain picture where the log lacks what its own would need."""
    found = []
    for maker in MAKERS.get(cause.effect, ()):
        try:
            found.append(maker(material, cause))
        except LookupError:  # a signal or a kind of motion that this log does not have
            continue
        if len(found) > 1:
            found[-1] = replace(found[-1], key=f"{found[-1].key}-{len(found)}")
    if not found:
        plain = residual(material, cause)
        found = [plain] if plain is not None else []
    return found


def strongest(material: Material, cause: NamedCause) -> tuple[str, Curve | None]:
    """The judged signal of the cause's group and the free-form curve that explains most of it."""
    signals = material.series.get(f"without {cause.effect}", {})
    best: tuple[str, Curve | None] = (next(iter(signals), ""), None)
    for part in material.parts.values():
        for signal, curves in part.before.items():
            if signal in signals and curves and (best[1] is None or curves[0].gain > best[1].gain):
                best = (signal, curves[0])
    return best


def angle_of(material: Material) -> str:
    """The signal by which the mechanics are judged."""
    found = [
        next(iter(p.noise))
        for n, p in material.parts.items()
        if n in ("mechanical", "simplified") and p.noise
    ]
    return found[0] if found else "slew"


def driver(material: Material, of: str, cause: NamedCause) -> Array | None:
    """(n,) SI of what a free-form curve is a function of, from predictions without noise where there are any."""
    extended = material.series[BLOCK_EXTENDED] | {
        s: v for s, v in material.measured.items() if s not in material.series[BLOCK_EXTENDED]
    }
    if of == "time":
        return material.time
    if of in ("omega", "theta"):
        angle = extended.get(angle_of(material))
        return angle if angle is None or of == "theta" else material.slopes(angle)[0]
    name = of.removeprefix("abs(").removesuffix(")").removesuffix("_rate")
    values = extended.get(name)
    if values is None:
        return None
    if of.startswith("abs("):
        return np.abs(values)
    return material.slopes(values)[0] if of.endswith("_rate") else values


def residual(material: Material, cause: NamedCause) -> Picture | None:
    """Residual of the cause's block without and with it, against what drives it most; None if nothing was kept."""
    signal, curve = strongest(material, cause)
    without = material.without(cause, signal)
    extended = material.series[BLOCK_EXTENDED].get(signal)
    if without is None or extended is None:
        return None
    of = curve.label.partition("(")[2].removesuffix(")") if curve else "time"
    x = driver(material, of, cause)
    if x is None:
        of, x = "time", material.time
    text, unit, scale = quantity(of)
    shown_unit, shown_scale = shown(signal)
    size = max(1, round(0.02 / material.h))
    layers = []
    for name, role, predicted in (("without it", "nominal", without), ("with it", "extended", extended)):
        _, values = averaged(x * scale, size)
        _, rest = averaged((material.measured[signal] - predicted) * shown_scale, size)
        at, mean, error = binned(values, rest, 0.5)
        layers.append(Layer("points", name, role, values, rest))  # type: ignore[arg-type]
        layers.append(Layer("means", f"mean in bins, {name}", role, at, mean, error))  # type: ignore[arg-type]
    return Picture(
        f"evidence-{cause.effect.replace('.', '-')}",
        f"Residual of the {signal_name(signal)} with and without {effect_name(cause.effect)}",
        axis(text, unit),
        [Panel(axis(f"residual of the {signal_name(signal)}", shown_unit), layers)],
        CAPTIONS["residual"].format(block=block_name(cause.block)),
    )


def free_form(block: str, signal: str, curve: Curve, key: str) -> Picture:
    """The free-form curve of what is missing."""
    what, _, of = curve.label.partition("(")
    of = of.removesuffix(")") if not of.startswith("abs(") else of.removesuffix("))") + ")"
    (x_text, x_unit, x_scale), (y_text, y_unit, y_scale) = quantity(of), lacking(what)
    driver = x_text
    along, changing, by = of.partition(CHANGING)
    if changing:  # the curve is of the factor, over what it changes with
        per_text, per_unit, per_scale = quantity(along)
        x_text, x_unit, x_scale = quantity(by)
        y_text, y_scale = f"{y_text} per {per_text}", y_scale / per_scale
        y_unit = y_unit if per_unit == "1" else f"{y_unit} per {per_unit}"
    layers = [
        Layer(
            "line",
            "piecewise linear, at quantiles of the data",
            "plain",
            curve.knots * x_scale,
            curve.values * y_scale,
        ),
        Layer(
            "points",
            "knots",
            "plain",
            curve.knots * x_scale,
            curve.values * y_scale,
        ),
    ]
    return Picture(
        key,
        f"{at_start(y_text)} against {x_text} ({block_name(block)}, seen in the {signal_name(signal)})",
        axis(x_text, x_unit),
        [Panel(axis(y_text, y_unit), layers)],
        CAPTIONS["free_form"].format(driver=driver, gain=curve.gain),
    )
