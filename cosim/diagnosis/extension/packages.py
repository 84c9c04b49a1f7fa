"""The extended model, written as packages that other clients can run."""

from collections.abc import Mapping
from pathlib import Path, PurePosixPath

import numpy as np
from numpy.typing import NDArray

from cosim.files import write_bytes
from cosim.ssp.write import NAMESPACES, STIMULUS, read_xml, values_xml, write_as_wired, write_ssp
from fmus import registry
from fmus.build import composed_block
from fmus.contract import Variable

Array = NDArray[np.float64]


def by_component(values: Mapping[str, float]) -> dict[str, dict[str, float]]:
    """``component.parameter`` -> value, grouped by component."""
    found: dict[str, dict[str, float]] = {}
    for name, value in values.items():
        component, _, parameter = name.partition(".")
        found.setdefault(component, {})[parameter] = value
    return found


def write_values(grouped: Mapping[str, Mapping[str, float]], stems: Mapping[str, str], file: Path) -> Path:
    """Write all values as one .ssv with names ``component.parameter``; `stems` says which FMU each component runs."""
    declared: dict[str, Variable] = {}
    values: dict[str, float] = {}
    for component, own in grouped.items():
        stem = stems.get(component, component)
        known = composed_block(registry.FMU_OF_COMPONENT.get(stem, stem), stem).parameters
        declared |= {f"{component}.{name}": known[name] for name in own}
        values |= {f"{component}.{name}": value for name, value in own.items()}
    file.parent.mkdir(parents=True, exist_ok=True)
    return write_bytes(file, values_xml(declared, values))


def write_extended(
    wiring: Path, values: Mapping[str, float], folder: Path, stimulus: bytes | None
) -> dict[str, Path]:
    """Write the extended packages: open (for our runner), and closed with the log's command inside.

    Args:
        wiring: the .ssd of the model; with a stimulus inside, or with inputs of its own.
        values: ``component.parameter`` -> SI that differs from what it binds.
        folder: where they go.
        stimulus: what plays the command; None, or a system without a stimulus, gives no closed package.
    """
    grouped, runs = by_component(values), stems(wiring)
    if STIMULUS not in runs:
        # a sensor may have been judged for which this system has no component
        own = {name: grouped[name] for name in runs if name in grouped}
        paths = {"open": write_as_wired(wiring, folder / "extended.ssp", own)}
    else:
        paths = {"open": write_ssp(wiring, folder / "extended_open.ssp", values=grouped, open=True)}
        if stimulus is not None:
            paths["closed"] = write_ssp(wiring, folder / "extended.ssp", values=grouped, stimulus=stimulus)
    if grouped:
        paths["ssv"] = write_values(grouped, runs, folder / "extended.ssv")
    return paths


def stems(wiring: Path) -> dict[str, str]:
    """Component -> name of the FMU that it runs, without its ending."""
    components = read_xml(wiring).findall(".//ssd:Component", NAMESPACES)
    return {c.get("name", ""): PurePosixPath(c.get("source", "")).stem for c in components}


def closed(wiring: Path) -> bool:
    """True for a system with a stimulus inside, from which a closed and an open package can be made."""
    return STIMULUS in stems(wiring)
