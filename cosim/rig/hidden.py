"""From ``mechanical.coulomb_friction:tau_c=300 N.m`` to the numbers of a crane."""

import difflib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

from cosim.errors import UsageError
from cosim.rig.parameters import EFFECTS, NOMINAL, PARAMETERS, PHYSICAL_B, Plant, nominal_value
from cosim.units import parse_quantity


def closest(name: str, known: Iterable[str]) -> str:
    """A remedy for an unknown name: the nearest known ones, or all of them when none is near."""
    names = list(known)
    near = difflib.get_close_matches(name, names, n=3, cutoff=0.5)
    return f"did you mean {' or '.join(near)}?" if near else f"known are: {', '.join(names)}"


def check_value(name: str, value: float) -> float:
    """`value` (SI) if the parameter ``component.parameter`` may have it.

    Raises:
        UsageError: it is outside the allowed range.
    """
    parameter = PARAMETERS[name]
    if not parameter.allows(value):
        zero = " (or 0 for none)" if parameter.or_zero else ""
        raise UsageError(
            f"{name} = {value:g} {parameter.unit} is outside {parameter.low:g} .. {parameter.high:g} "
            f"{parameter.unit}{zero}"
        )
    return value


@dataclass(frozen=True)
class Hidden:
    """An effect to hide and the values (SI) of its parameters, by their short names.

    No values: the moderate default size. With some values given, the others keep their off value.

    Raises:
        UsageError: the effect or a parameter is unknown, or a value is outside its range.
    """

    effect: str
    values: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Check names and ranges at once, so that a mistake is reported where it is made."""
        if self.effect not in EFFECTS:
            raise UsageError(f"unknown effect '{self.effect}': {closest(self.effect, EFFECTS)}")
        for name, value in self.values.items():
            check_value(self.full_name(name), float(value))

    def full_name(self, name: str) -> str:
        """``component.parameter`` of one of the effect's parameters, given its short name."""
        for full in EFFECTS[self.effect].moderate:
            if full.split(".")[1] == name:
                return full
        known = [full.split(".")[1] for full in EFFECTS[self.effect].moderate]
        raise UsageError(f"{self.effect} has no parameter '{name}': {closest(name, known)}")

    def numbers(self) -> dict[str, float]:
        """All parameters of the effect: ``component.parameter`` -> value (SI)."""
        if not self.values:
            return dict(EFFECTS[self.effect].moderate)
        given = {self.full_name(name): float(value) for name, value in self.values.items()}
        return EFFECTS[self.effect].off() | given

    @staticmethod
    def parse(text: str) -> "Hidden":
        """Read ``effect`` or ``effect:name=value unit,name=value unit``.

        Raises:
            UsageError: the text cannot be read, or names what does not exist.
        """
        effect, _, rest = text.partition(":")
        hidden = Hidden(effect.strip())
        values: dict[str, float] = {}
        for part in filter(None, (piece.strip() for piece in rest.split(","))):
            name, equals, quantity = part.partition("=")
            if not equals:
                raise UsageError(f"'{part}' in --hide '{text}' should read name=value, such as tau_c=300 N.m")
            full = hidden.full_name(name.strip())
            values[name.strip()] = parse_quantity(quantity, PARAMETERS[full].unit)
        return Hidden(hidden.effect, values)

    def truth(self) -> dict[str, object]:
        """The effect as plain data: name, block, and value and unit of each parameter."""
        numbers = self.numbers()
        return {
            "effect": self.effect,
            "block": EFFECTS[self.effect].block,
            "parameters": {
                full.split(".")[1]: {"value": value, "unit": PARAMETERS[full].unit}
                for full, value in numbers.items()
            },
        }


def parse_setting(text: str) -> tuple[str, float]:
    """Read ``component.parameter=value unit`` into its name and value (SI).

    Raises:
        UsageError: there is no such parameter, or the value cannot be read or is outside its range.
    """
    name, equals, quantity = text.partition("=")
    name = name.strip()
    if not equals:
        raise UsageError(
            f"--set '{text}' should read component.parameter=value, such as mechanical.J=800 kg.m2"
        )
    if name not in PARAMETERS:
        raise UsageError(f"unknown parameter '{name}': {closest(name, PARAMETERS)}")
    return name, check_value(name, parse_quantity(quantity, PARAMETERS[name].unit))


def assemble(hidden: Iterable[Hidden], settings: Mapping[str, float]) -> Plant:
    """The crane with all of `hidden` in it and the parameters `settings` (``component.parameter`` -> SI) changed.

    Raises:
        UsageError: two of them want different values of one parameter, or a setting is unknown or out of range.
    """
    chosen: dict[str, tuple[float, str]] = {}
    wishes = [(name, value, item.effect) for item in hidden for name, value in item.numbers().items()]
    wishes += [(name, float(value), "--set") for name, value in settings.items()]
    for name, value, who in wishes:
        if name not in PARAMETERS:
            raise UsageError(f"unknown parameter '{name}': {closest(name, PARAMETERS)}")
        check_value(name, value)
        if name in chosen and chosen[name][0] != value:
            raise UsageError(
                f"{chosen[name][1]} wants {name} = {chosen[name][0]:g} and {who} wants {value:g} "
                f"{PARAMETERS[name].unit}: give one value"
            )
        chosen[name] = (value, who)
    blocks: dict[str, object] = {}
    for component, block in NOMINAL._asdict().items():
        changes = {n.split(".")[1]: v for n, (v, _) in chosen.items() if n.split(".")[0] == component}
        blocks[component] = block._replace(**changes)
    return Plant(**blocks)  # type: ignore[arg-type]


def changed(plant: Plant) -> dict[str, float]:
    """All parameters of `plant` that are not nominal: ``component.parameter`` -> value (SI)."""
    values = {
        name: float(getattr(getattr(plant, name.split(".")[0]), name.split(".")[1])) for name in PARAMETERS
    }
    c, usual = plant.continuity, dict[str, float]()
    if c.physical:  # what a share added makes of the block's own numbers, by which a model finds it
        usual = {"mechanical.b": PHYSICAL_B, "continuity.physical": 1.0}
        values |= {"continuity.C_L": c.C_L * (1.0 + c.c_l), "continuity.beta": c.beta / (1.0 + c.c_beta)}
    return {name: value for name, value in values.items() if value != usual.get(name, nominal_value(name))}
