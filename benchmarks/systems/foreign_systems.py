"""Two to four FMUs of other people wired to chains and loops, with something hidden that a seed draws.

That is a port effect, a parameter, or nothing. Sizes are drawn as in the random systems; fmpy makes the log
(`benchmarks.systems.foreign`).
"""

import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.any_system import EFFECTS, READINGS, size
from benchmarks.systems import foreign
from benchmarks.systems.foreign import Case, located, truth
from benchmarks.systems.truth import Hidden

Array = NDArray[np.float64]
CLASSES = ("port", "parameter", "none")
SEEN = 3.0  # times its noise: so much of some reading must be changed, or the draw is made again
DRAWS = 20

ADD, GAIN = "LinearTransformation/resources/Add.fmu", "LinearTransformation/resources/Gain.fmu"
FEED, VAN, DAHL = "reference/Feedthrough.fmu", "reference/VanDerPol.fmu", "reference/Dahlquist.fmu"
SPRUNG = "2023x/2.0/SpringPendulumExtForce1D.fmu"
PORT_IN, PORT_OUT = "Float64_continuous_input", "Float64_continuous_output"
MASS1, MASS2 = "resources/MassSpringDamper1.fmu", "resources/MassSpringDamper2.fmu"

SYSTEMS: tuple[Case, ...] = (
    Case("motor and load", {"machine": "emachine_model.fmu", "load": "edrive_mass.fmu"},
         {"U": (0.0, 12.0), "M_B": (0.0, 0.02)}, ("machine.I", "machine.M", "load.wA", "load.phiA"),
         wires=(("U", "machine.U"), ("M_B", "load.M_B"), ("load.wA", "machine.w"), ("load.phiA", "machine.phi"),
                ("machine.M", "load.M_A")),
         trusted=("machine.resistor.R", "machine.emf.k", "load.inertia.J", "load.damper.d")),
    Case("two masses", {"one": MASS1, "two": MASS2}, {}, ("one.x1", "one.v1", "two.fk", "two.x2", "two.v2"),
         values={"two.dc": 5.0}, wires=(("one.x1", "two.x1"), ("one.v1", "two.v1"), ("two.fk", "one.fk")),
         trusted=("one.m1", "one.c1", "two.m2", "two.c2", "two.dc")),
    Case("feed and mass", {"feed": FEED, "mass": MASS1}, {"u": (0.0, 2.0)}, ("feed." + PORT_OUT, "mass.x1", "mass.v1"),
         wires=(("u", "feed." + PORT_IN), ("feed." + PORT_OUT, "mass.fk")), trusted=("mass.m1", "mass.c1", "mass.d1")),
    Case("oscillator to pendulum", {"source": VAN, "gain": GAIN, "feed": FEED, "swing": SPRUNG}, {},
         ("source.x0", "gain.y", "feed." + PORT_OUT, "swing.v", "swing.a"), values={"gain.k": 2.0},
         wires=(("source.x0", "gain.u"), ("gain.y", "feed." + PORT_IN), ("feed." + PORT_OUT, "swing.extForce")),
         trusted=("source.mu", "gain.k", "swing.mass.m", "swing.spring.c")),
    Case("two sources", {"van": VAN, "dahl": DAHL, "sum": ADD, "swing": SPRUNG}, {},
         ("van.x1", "dahl.x", "sum.y", "swing.v"), values={"sum.k2": 3.0, "dahl.k": 0.2},
         wires=(("van.x1", "sum.u1"), ("dahl.x", "sum.u2"), ("sum.y", "swing.extForce")),
         trusted=("van.mu", "dahl.k", "sum.k1", "sum.k2", "swing.mass.m")),
    Case("controlled mass", {"sum": ADD, "mass": MASS1, "back": GAIN}, {"u1": (0.0, 2.0)},
         ("sum.y", "mass.x1", "mass.v1", "back.y"), values={"back.k": 2.5, "sum.k2": -1.0},
         wires=(("u1", "sum.u1"), ("back.y", "sum.u2"), ("sum.y", "mass.fk"), ("mass.x1", "back.u")),
         trusted=("sum.k1", "mass.m1", "mass.c1", "back.k")),
    Case("chain of three", {"first": GAIN, "mass": MASS1, "swing": SPRUNG}, {"u": (0.0, 2.0)},
         ("mass.x1", "mass.v1", "swing.v", "swing.a"), wires=(("u", "first.u"), ("first.y", "mass.fk"),
         ("mass.x1", "swing.extForce")), trusted=("first.k", "mass.m1", "mass.d1", "swing.mass.m")),
    Case("decay through two", {"dahl": DAHL, "mass": MASS1, "swing": SPRUNG}, {},
         ("dahl.x", "mass.x1", "swing.v", "swing.a"), values={"dahl.k": 0.3},
         wires=(("dahl.x", "mass.fk"), ("mass.x1", "swing.extForce")),
         trusted=("dahl.k", "mass.m1", "mass.c1", "swing.spring.c")),
)  # fmt: skip


def draw(seed: int, paths: Sequence[Path]) -> Case | None:
    """The system of a seed and what is hidden in it; None where an FMU is not there or nothing drawn can be seen."""
    rng = np.random.default_rng(seed)
    base = SYSTEMS[seed % len(SYSTEMS)]
    base = replace(base, fine=10, tolerance=1e-8, name=f"{base.name} {seed}")
    fmus = located(base, paths)
    if fmus is None:
        return None
    kind = CLASSES[seed // len(SYSTEMS) % len(CLASSES)]
    if kind == "port" and seed // (len(SYSTEMS) * len(CLASSES)) % 2:
        base = replace(base, trusted=())
    if kind == "none":
        return base
    with tempfile.TemporaryDirectory() as name:
        scratch = Path(name)
        clean = truth(replace(base, noise=0.0), fmus, seed, scratch)
        for _ in range(DRAWS):
            case = faulty(base, kind, clean, rng)
            try:
                series = truth(replace(case, noise=0.0), fmus, seed, scratch)
            except RuntimeError:  # an FMU that cannot be run so
                continue
            if seen(clean, series) > SEEN:
                return case
    return None


def seen(clean: Mapping[str, Array], series: Mapping[str, Array]) -> float:
    """The largest change of a reading (RMS) over its noise."""
    return max(
        float(np.sqrt(np.mean((series[n] - clean[n]) ** 2)) / max(foreign.NOISE * np.std(clean[n]), 1e-300))
        for n in clean
        if "." in n
    )


def faulty(base: Case, kind: str, clean: Mapping[str, Array], rng: np.random.Generator) -> Case:
    """The system with a fault drawn."""
    if kind == "parameter":
        factor = float(rng.choice([rng.uniform(0.7, 0.88), rng.uniform(1.12, 1.4)]))
        return replace(base, faults={str(rng.choice(base.trusted)): round(factor, 3)})
    effect = str(rng.choice([e for e in EFFECTS if e != "port.dropout"]))
    feeds = {end: source for source, end in base.wires}
    where = "sensor" if effect in READINGS else str(rng.choice(["input", "output", "sensor"]))
    ports = list(base.measured)
    if where == "input":
        ports = [end for end, source in feeds.items() if source in clean]
    port = str(rng.choice(ports))
    series = clean[feeds[port] if where == "input" else port]
    values = {n: round(v, 5) for n, v in size(effect, series, rng).items()}
    return replace(base, hidden=(Hidden(effect, port, where, values),))
