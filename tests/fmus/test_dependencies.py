"""What ModelStructure lists is what acts: changed numbers show it, and a master that follows it finds no false loop."""

import itertools
import zipfile
from graphlib import TopologicalSorter

import numpy as np
import pytest
from lxml import etree

from cosim.native.container import container
from cosim.native.model import single
from cosim.paths import ssp_folder
from cosim.ssp.read import read_system
from cosim.ssp.write import write_ssp
from fmus import registry
from fmus.build import composed_block
from fmus.compose import compose
from fmus.contract import Effect, Variable, equation
from fmus.dependencies import after_step, at_start
from fmus.describe import model_description

# of what a start depends on, but not alone: an effect that must be on, a value that another one limits
FAR = {
    "dead_zone": {"command": (-2.0, 2.0)},
    "dcv": {"spool_0": (-3e-3, 3e-3)},
    "continuity": {"p_c": (0.0, 2e6), "s_c": (0.0, 1.0), "k_s": (0.0, 1e10), "p_load_0": (-5e6, 5e6)},
    "mechanical": {"theta_0": (-2.0, 2.0), "omega_0": (-1.0, 1.0), "theta_min": (-2.0, -0.1), "theta_max": (0.1, 2.0),
                   "gap": (0.0, 0.1), "e_l": (-0.5, 0.5)},
    "simplified": {"theta_0": (-2.0, 2.0), "omega_0": (-1.0, 1.0), "theta_min": (-2.0, -0.1), "theta_max": (0.1, 2.0)},
    "linear_drive": {"command": (-2.0, 2.0), "u_0": (-2.0, 2.0), "settled": (0.0, 1.0)},
    "linear_speed": {"command": (-2.0, 2.0), "u_0": (-2.0, 2.0), "settled": (0.0, 1.0)},
    "sensor": {"theta": (-1.0, 1.0), "low": (-1.0, 0.0), "high": (0.0, 1.0)},
    "reference": {"t_switch": (-1.0, 1.0)},
    "controller": {"automatic": (0.0, 1.0), "d_plus": (0.0, 0.5), "d_minus": (0.0, 0.5)},
}  # fmt: skip
# listed although it makes no difference: both sides start alike, or a state that starts at 0 is multiplied with it
CANCELS = {
    "continuity": {("p_a", "k_s"), ("p_b", "k_s"), ("p_supply", "k_s")},
    "continuity_physical": {("p_load", "p_s"), ("p_load", "p_t")},
    "mechanical": {("theta", "gap")},
}


def started(composed, values):
    """Outputs at initialisation."""
    module = composed.module
    u = module.Input(*(0.0 if v.kind == "time" else values[n] for n, v in composed.block.inputs.items()))
    p = module.Parameters(*(values[n] for n in composed.parameters))
    buffers = [np.array([-0.2, 0.7, 1.4]) for b in composed.memory.values() if hasattr(b, "length")]
    x = module.start(u, p)
    y = module.output(x, u, module.begin(x, u, p, buffers), p)
    return dict(zip(composed.outputs, y, strict=True))


@pytest.mark.parametrize("block", registry.BLOCKS)
def test_a_start_depends_on_what_is_listed_and_on_nothing_else(block):
    composed, rng = composed_block(block), np.random.default_rng(3)
    declared = composed.inputs | composed.parameters
    seen = set()

    def drawn(name):
        v = declared[name]
        if v.kind == "integer":
            return float(rng.integers(int(v.low), int(v.high) + 1))
        low, high = FAR.get(block, {}).get(name, (v.start - 0.3 * v.nominal, v.start + 0.3 * v.nominal))
        return float(np.clip(rng.uniform(low, high), v.low, v.high))

    for _ in range(100):
        values = {n: drawn(n) if rng.random() < 0.7 else v.start for n, v in declared.items()}
        before = started(composed, values)
        for name in declared:
            after = started(composed, {**values, name: drawn(name)})
            seen |= {(output, name) for output in composed.outputs if after[output] != before[output]}
    listed = {(output, name) for output in composed.outputs for name in at_start(composed)[output]}
    assert seen <= listed
    assert listed - seen == CANCELS.get(block, set())


def test_what_was_asked_before_changes_no_answer():
    """Answers are kept by the block's text: with the time and without, and whatever is done with one of them."""
    stimulus = composed_block("stimulus")
    (time,) = (n for n, v in stimulus.block.inputs.items() if v.kind == "time")
    for _ in range(2):
        timed, plain = at_start(stimulus, time=True), at_start(stimulus)
        assert time in frozenset().union(*timed.values())
        assert time not in frozenset().union(*plain.values())
        assert plain.keys() == timed.keys()
        plain.clear()
    assert at_start(composed_block("reference")) != at_start(stimulus)


@equation
def capped(slew, m, p):
    """Said in ways that our own equations do not use."""
    with_cap = [value for value in (slew, p.cap)]  # noqa: C416
    return min(*with_cap) if p.cap > 0.0 else max((slew, 0.0), key=lambda one: one)


def test_text_that_is_not_followed_counts_as_a_whole():
    """An effect of somebody else may be any Python: never too small a set."""
    effect = Effect(
        name="sensor.cap", text="t", residual="r", source="s", key="cap", fills={"transmitted": capped},
        parameters={"cap": Variable("1", "Cap", 0.0, 0.0, 1.0, source="off")},
    )  # fmt: skip
    found = after_step(compose(registry.block("sensor"), [effect]))
    assert {"cap", "theta", "gain", "bias"} <= found["slew"]
    assert "cap" not in found["reading"]


def unknowns(root, section):
    """Name of each unknown of a section -> names that it depends on; None where all are assumed."""
    names = [v.get("name") for v in root.find("ModelVariables")]
    return {
        names[int(u.get("index")) - 1]: None
        if u.get("dependencies") is None
        else {names[int(i) - 1] for i in u.get("dependencies").split()}
        for u in root.findall(f"ModelStructure/{section}/Unknown")
    }


@pytest.mark.parametrize("block", registry.BLOCKS)
def test_descriptions_list_them_and_a_tolerance(block):
    composed = composed_block(block)
    root = model_description(composed, {}, b"")
    starts = at_start(composed)
    assert unknowns(root, "InitialUnknowns") == {n: set(starts[n]) for n in composed.outputs}
    direct = composed.block.feedthrough
    assert unknowns(root, "Outputs") == {n: set(direct.get(n, ())) for n in composed.outputs}
    assert float(root.find("DefaultExperiment").get("tolerance")) == 1e-6


@pytest.mark.parametrize("name", ["full_order", "physical", "simplified"])
def test_a_master_that_follows_the_lists_finds_no_loop_at_initialisation(name, tmp_path):
    package = write_ssp(ssp_folder() / f"{name}.ssd", tmp_path / f"{name}.ssp", open=True)
    graph: dict[tuple[str, str], set[tuple[str, str]]] = {}
    with read_system(package) as system, zipfile.ZipFile(package):
        for component in system.components.values():
            root = etree.parse(component.fmu.folder / "modelDescription.xml").getroot()
            inputs = {v.name for v in component.fmu.variables.values() if v.causality == "input"}
            for output, names in unknowns(root, "InitialUnknowns").items():
                known = inputs if names is None else names & inputs
                graph[component.name, output] = {(component.name, n) for n in known}
        for wire in system.wires:
            graph[wire.target.component, wire.target.variable] = {
                (wire.source.component, wire.source.variable)
            }
    order = list(TopologicalSorter(graph).static_order())  # CycleError, were there a loop
    assert set(itertools.chain(graph, *graph.values())) == set(order)


def test_a_chain_depends_on_what_its_parts_do():
    chain = container(ssp_folder() / "physical.ssd").initial
    assert chain["spool"] == {"dcv.spool_0", "dcv.x_min", "dcv.x_max"}
    assert "u" in chain["dead_zone_demand"]
    assert {"compensator.S", "dead_zone.b_l"} <= chain["dead_zone_demand"]
    assert {n for n, names in chain.items() if "u" in names} == {"compensator_demand", "dead_zone_demand"}
    assert {"mechanical.theta_0", "sensor.bias", "observer.c"} <= chain["slew_estimate"]
    assert single(composed_block("sensor"), {}).initial["slew"] == at_start(composed_block("sensor"))["slew"]
