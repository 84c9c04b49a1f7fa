"""Parameters with their 95 % intervals from files: diagnosis.json, calibration.json, or an .ssv that carries intervals.

In an .ssv the interval of a parameter stands in an annotation, in the unit of its value; other programs ignore it:

    <ssv:Parameter name="mechanical.J">
      <ssv:Real value="763.9" unit="kg.m2"/>
      <ssv:Annotations><ssc:Annotation type="slew-cosim.ci95"><ci95 low="745" high="790"/></ssc:Annotation></ssv:Annotations>
    </ssv:Parameter>
"""

import json
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from lxml import etree

from cosim.correlation import correlations
from cosim.diagnosis.answer.schema import Answer, Parameter
from cosim.errors import DataError, ModelError, UsageError
from cosim.ssp.parameters import read_ssv
from cosim.ssp.xml import IN_SSC, IN_SSV, parse
from fmus import registry

ANNOTATION = "slew-cosim.ci95"


@dataclass(frozen=True)
class Estimate:
    """A parameter as a file gives it: text such as ``763.9 [745, 790] kg.m2``, or without interval ``763.9 kg.m2``."""

    name: str
    value: float
    unit: str
    ci95: tuple[float, float] | None

    @property
    def text(self) -> str:
        """As `cosim.batch.values` reads it."""
        if self.ci95 is None:
            return f"{self.value!r} {self.unit}"
        return f"{self.value!r} [{self.ci95[0]!r}, {self.ci95[1]!r}] {self.unit}"


@dataclass(frozen=True)
class Estimates:
    """What a file holds.

    Attributes:
        uncertain: parameters with an interval.
        known: parameters without one.
        correlations: of their estimates, by pairs of names; 0 for those that are not here.
        model: the package they belong to, where the file names one.
        notes: what the user should know.
    """

    uncertain: tuple[Estimate, ...]
    known: tuple[Estimate, ...]
    model: str | None = None
    correlations: dict[tuple[str, str], float] = field(default_factory=dict)


def read_estimates(path: Path) -> Estimates:
    """Parameters and intervals of a diagnosis.json, calibration.json or .ssv file.

    Raises:
        DataError: it is neither a diagnosis nor a calibration.
        ModelError: it is no parameter set.
        UsageError: another suffix, or it holds no interval.
    """
    suffix = path.suffix.lower()
    if suffix not in (".json", ".ssv"):
        raise UsageError(f"--from {path}: give a diagnosis.json, a calibration.json or an .ssv file")
    found = _from_json(path) if suffix == ".json" else _parameter_set(path)
    if not found.uncertain:
        raise UsageError(f"{path} holds no parameter with a 95 % interval, so there is nothing to vary")
    return found


def _from_json(path: Path) -> Estimates:
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        if isinstance(content, dict) and "verdict" not in content and "parameters" in content:
            return _calibration(content)
        return _diagnosis(path, Answer.model_validate(content))
    except OSError as error:
        raise DataError(f"{path} cannot be read: {error.strerror or error}") from None
    except (ValueError, KeyError, TypeError) as error:  # ValidationError is a ValueError
        first = str(error).splitlines()[0]
        raise DataError(f"{path} is no diagnosis.json or calibration.json of this version: {first}") from None


def _calibration(content: dict[str, Any]) -> Estimates:
    """Parameters as `cosim.calibrate.present.as_data` writes them, in the FMU's units; undetermined ones are left alone."""
    found = [
        Estimate(p["name"], float(p["value"]), p["unit"] or "", tuple(p["ci95"]) if p["ci95"] else None)
        for p in content["parameters"]
        if p["determined"]
    ]
    found += [Estimate(name, float(value), "", None) for name, value in content["start_values"].items()]
    names = [p["name"] for p in content["parameters"]]
    rows = np.array(content["covariance"], dtype=float)
    if rows.shape != (len(names), len(names)):
        raise ValueError(f"its covariance is not that of its {len(names)} parameters")
    return replace(_sorted(found, None), correlations=correlations(names, rows))


def _diagnosis(path: Path, answer: Answer) -> Estimates:
    pairs = dict(answer.nominal)
    for cause in answer.causes:
        effect = registry.effects().get(cause.effect)
        component = effect.component if effect else cause.block
        if component == "tracker":
            continue  # belongs to the record, not to the model
        pairs |= {f"{component}.{name}": parameter for name, parameter in cause.parameters.items()}
    estimates = [_estimate(name, parameter) for name, parameter in pairs.items()]
    model = answer.model
    if answer.extended is not None:
        named = Path(answer.extended.ssp)
        model = str(next((p for p in (path.parent / named.name, named) if p.is_file()), named))
    together = {c.parameters: c.correlation for c in answer.correlations}
    return replace(_sorted(estimates, model), correlations=together)


def _estimate(name: str, parameter: Parameter) -> Estimate:
    low, high = parameter.ci95
    return Estimate(name, parameter.value, parameter.unit, (low, high) if low < high else None)


def _parameter_set(path: Path) -> Estimates:
    values = read_ssv(path)
    intervals = dict(_intervals(path))
    found = [
        Estimate(v.name, float(v.value), v.unit or "1", intervals.get(v.name))
        for v in values
        if v.kind == "Real"
    ]
    return _sorted(found, None)


def _intervals(path: Path) -> Iterator[tuple[str, tuple[float, float]]]:
    root = parse(path.read_bytes(), str(path))
    for parameter in root.iterfind(f"{IN_SSV}Parameters/{IN_SSV}Parameter"):
        for note in parameter.iterfind(f"{IN_SSV}Annotations/{IN_SSC}Annotation[@type='{ANNOTATION}']"):
            name = parameter.get("name", "")
            child = next((c for c in note if etree.QName(c).localname == "ci95"), None)
            try:
                if child is None:
                    raise KeyError("ci95")
                yield name, (float(child.attrib["low"]), float(child.attrib["high"]))
            except (KeyError, ValueError):
                raise ModelError(
                    f"{path}: the annotation of '{name}' should hold <ci95 low='..' high='..'/>"
                ) from None


def _sorted(estimates: list[Estimate], model: str | None) -> Estimates:
    return Estimates(tuple(e for e in estimates if e.ci95), tuple(e for e in estimates if not e.ci95), model)
