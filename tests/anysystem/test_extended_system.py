"""The extended package: an effect in the wire, the same in Python and native, and nearer to what was measured."""

import hashlib
import json
import os
from pathlib import Path

import numpy as np
import pytest
import systems
from lxml import etree

from benchmarks.systems.truth import Hidden
from cosim.anysystem.actions import Action
from cosim.anysystem.extend import NAMES, element_name, in_turn, insert
from cosim.logs.source import digest
from cosim.master import Runner
from cosim.native.build import build_native
from cosim.ssp.system import Port
from cosim.ssp.traceability import embedded
from cosim.ssp.write import NAMESPACES
from cosim.system.effects import EFFECTS
from fmus.build import build_fmu
from fmus.compose import compose
from fmus.port_effect import BLOCK

SIZES = {
    "port.gain": {"gain": 0.5},
    "port.offset": {"offset": 0.3},
    "port.delay": {"delay": 0.083},
    "port.lag": {"lag": 0.2},
    "port.saturation": {"low": -0.5, "high": 0.7},
    "port.dead_zone": {"low": -0.2, "high": 0.3},
    "port.play": {"half_width": 0.2},
    "port.rate_limit": {"rate": 1.0},
    "port.quantisation": {"quantum": 0.1},
    "port.drift": {"rate": 0.1},
}


@pytest.mark.parametrize(
    ("port", "where", "way"),
    [
        (Port("a", "y"), "output", ["a", "dead_zone_a_y_output", "rate_limit_a_y_output", "b"]),
        (Port("b", "u"), "input", ["a", "dead_zone_b_u_input", "rate_limit_b_u_input", "b"]),
        (Port("a", "y"), "sensor", ["a", "dead_zone_a_y_sensor", "rate_limit_a_y_sensor", ""]),
    ],
)
@pytest.mark.parametrize("first", [0, 1])
def test_effects_at_one_port_stand_in_the_order_of_the_fit(
    port: Port, where: str, way: list[str], first: int
) -> None:
    """A rate limit before a dead zone hears the jumps that it does not hear behind one."""
    ssd = NAMESPACES["ssd"]
    root = etree.fromstring(
        f"<s:System xmlns:s='{ssd}' name='s'><s:Elements><s:Component name='a'/><s:Component name='b'/></s:Elements>"
        "<s:Connections><s:Connection startElement='a' startConnector='y' endElement='b' endConnector='u'/>"
        "</s:Connections></s:System>"
    )
    both = [(Action(effect, port, where), {"x": 1.0}) for effect in ("port.dead_zone", "port.rate_limit")]
    for action, _ in in_turn(both if first == 0 else both[::-1]):
        insert(root, action, element_name(action))
    follows = {}
    for wire in root.iter(f"{{{ssd}}}Connection"):
        follows.setdefault(wire.get("startElement"), []).append(wire.get("endElement", ""))
    assert [follows[name][-1] for name in way[:-1]] == way[1:]


def test_every_effect_of_the_search_is_that_of_the_fmu_in_the_wire(tmp_path: Path) -> None:
    t = 0.01 * np.arange(501)
    u = np.sin(2 * t) + 0.5 * np.sin(7 * t)
    module = compose(BLOCK).module
    off = {n: v.start for n, v in BLOCK.parameters.items()}
    for effect, values in SIZES.items():
        own = {NAMES.get((effect, n), n): v for n, v in values.items()}
        p = module.Parameters(**off | own)
        x, c = module.start(module.Input(u[0]), p), module.coefficients(p, 0.01)
        m = module.begin(x, module.Input(u[0]), p, [np.zeros(BLOCK.memory["ring"].length)])
        y = [module.output(x, module.Input(u[0]), m, p).y]
        for value in u[1:]:
            x, m = module.advance(x, m, module.Input(value), p, c)
            y.append(module.output(x, module.Input(value), m, p).y)
        assert np.allclose(y, EFFECTS[effect].act(u, 0.01, values), rtol=0.0, atol=1e-12), effect


def test_python_and_native_fmu_agree(tmp_path: Path) -> None:
    values = {"delay": 0.083, "zone_high": 0.2, "rate": 2.0}
    t = 0.01 * np.arange(301)
    signals = []
    for make, name in ((build_fmu, "python"), (build_native, "native")):
        with Runner(make(compose(BLOCK), tmp_path / f"{name}.fmu", values)) as runner:
            result = runner.run(3.0, 0.01, inputs={"u": (t, np.sin(5 * t))}, hold=())
        signals.append(result.signals[f"{name}.y"])
    assert np.abs(signals[0]).max() > 0.1
    assert np.array_equal(*signals)


def test_the_extended_package_is_nearer_to_the_log(
    native: Path, command, tmp_path: Path, monkeypatch
) -> None:
    named, rename = [], os.replace

    def noted(part, target, **options):
        named.append(Path(target))
        rename(part, target, **options)

    monkeypatch.setattr(os, "replace", noted)
    hidden = Hidden("port.dead_zone", "plant.u", "input", {"low": -0.2, "high": 0.3})
    log = systems.log(tmp_path / "log.csv", [hidden], 2)
    code, out, err = command("diagnose", log, "--model", native, "--out", tmp_path / "o", "--json")
    assert code == 0, err
    extended = json.loads(out)["extended"]
    table = np.loadtxt(log, delimiter=",", skiprows=1)
    errors = {}
    for model in (native, Path(extended["ssp"]), Path(extended["ssp"]).with_name("extended_native.ssp")):
        with Runner(model) as runner:
            time = systems.H * np.arange(systems.COUNT)
            result = runner.run(
                float(time[-1]),
                systems.H,
                inputs={"command": (time, table[:, 1])},
                record=["plant.y"],
                hold=(),
            )
        errors[model.name] = float(np.std(result.signals["plant.y"] - table[:, 3]))
    assert errors["extended.ssp"] < 0.3 * errors[native.name]
    assert errors["extended_native.ssp"] == pytest.approx(errors["extended.ssp"], rel=1e-9)
    assert digest(Path(extended["ssp"])) != digest(native)
    told = [embedded(Path(extended["ssp"]).with_name(n)) for n in ("extended.ssp", "extended_native.ssp")]
    assert told[0] == told[1]
    assert told[0]["data"]["log.csv"] == hashlib.sha256(log.read_bytes()).hexdigest()
    assert told[0]["diagnosis"]["cause.1"] == "port.dead_zone"
    written = [path.name for path in named if path.parent == tmp_path / "o"]
    assert sorted(written) == sorted({*written})  # none is written again once it has its name
    assert {"diagnosis.json", "extended.ssp", "extended.ssv", "extended_native.ssp"} <= {*written}
