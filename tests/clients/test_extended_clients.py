"""The extended package of any system, unchanged, in fmpy, ecos and libcosim: the effect in the wire acts there."""

import importlib.util
import zipfile
from pathlib import Path

import numpy as np
import pytest

from benchmarks.engines import MODULES, run_engine
from benchmarks.systems import parts
from cosim.anysystem.actions import Action
from cosim.anysystem.extend import write_package
from cosim.master import Runner
from cosim.native.build import build_native
from cosim.ssp.read import read_system
from cosim.ssp.system import Port
from fmus.build import build_fmu
from fmus.compose import compose
from fmus.port_effect import BLOCK

pytestmark = pytest.mark.clients
H, STEPS = 1e-3, 3000
CLIENTS = ("fmpy", "ecos", "libcosim")
EFFECT = Action("port.dead_zone", Port("plant", "u"), "input")
SIGNALS = ("source.y", "valve.y", "plant.y")


ROOT = (
    b"""<ssd:SystemStructureDescription xmlns:osp="http://opensimulationplatform.com/SSP/OSPAnnotations\""""
)
STEP = f"""<ssd:DefaultExperiment startTime="0" stopTime="3"><ssd:Annotations>
<ssc:Annotation type="com.opensimulationplatform">
<osp:Algorithm><osp:FixedStepAlgorithm baseStepSize="{H}"/>
</osp:Algorithm></ssc:Annotation></ssd:Annotations></ssd:DefaultExperiment></ssd:SystemStructureDescription>"""


def with_step(package: Path, target: Path) -> Path:
    """The package with the annotation by which libcosim knows its step; without, libcosimpy dies."""
    with zipfile.ZipFile(package) as source, zipfile.ZipFile(target, "w") as archive:
        for name in source.namelist():
            content = source.read(name)
            if name == "SystemStructure.ssd":
                # on the root: libcosim takes an attribute of the algorithm for one
                content = content.replace(b"<ssd:SystemStructureDescription", ROOT, 1)
                content = content.replace(b"</ssd:SystemStructureDescription>", STEP.encode())
            archive.writestr(name, content)
    return target


@pytest.fixture(scope="module")
def packages(tmp_path_factory):
    """A source, a valve and a plant; the same with a dead zone in the second wire, in Python and native."""
    if parts.COMPILER is None:
        pytest.skip("no C compiler")
    folder = tmp_path_factory.mktemp("extended")
    fmus = {
        "source": build_native(compose(BLOCK), folder / "source.fmu", {"offset": 0.5}),
        "valve": parts.native("lag", folder),
        "plant": parts.native("second", folder),
    }
    # those that the FMUs have: fmpy and ecos obey none that a package gives inline
    values = {"source": {"offset": 0.5}, "valve": {"K": 1.0, "T": 1.0}, "plant": {"K": 1.0, "W": 1.0}}
    wires = [("source.y", "valve.u"), ("valve.y", "plant.u")]
    found = {
        "plain": with_step(
            parts.write_ssp(folder / "bare.ssp", fmus, wires, values, []), folder / "plain.ssp"
        )
    }
    with read_system(found["plain"]) as system:
        for name, make in (("python", build_fmu), ("native", build_native)):
            starts = {"zone_low": -0.1, "zone_high": 0.15}
            found[name] = write_package(system, [(EFFECT, starts)], {}, folder / f"{name}.ssp", make)
    return found


def by_us(package: Path) -> np.ndarray:
    with Runner(package) as runner:
        return runner.run(STEPS * H, H, record=["plant.y"])["plant.y"]


# each client and each kind of FMU in every run, all pairs with the slow tests
QUICK = {"fmpy": "python", "ecos": "native", "libcosim": "python"}


@pytest.mark.parametrize(
    ("engine", "kind"),
    [
        pytest.param(e, k, marks=() if QUICK[e] == k else pytest.mark.slow)
        for e in CLIENTS
        for k in ("python", "native")
    ],
)
def test_the_effect_in_the_wire_acts_in_every_client(engine, kind, packages):
    if importlib.util.find_spec(MODULES[engine]) is None:
        pytest.skip(f"{MODULES[engine]} is not installed: pip install 'slew-cosim[clients]'")
    found, _ = run_engine(engine, packages[kind], steps=STEPS, h=H, signals=SIGNALS, timeout=600)
    plain, extended = (
        np.interp(found["time"], H * np.arange(STEPS + 1), by_us(packages[p])) for p in ("plain", kind)
    )
    effect = float(np.std(extended - plain))
    assert effect > 0.05
    # these masters hand each value on a step later, wire by wire
    assert float(np.std(found["plant.y"] - extended)) < 0.1 * effect
