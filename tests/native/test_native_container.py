"""A chain as one FMU gives what our master gives for the package of its components."""

import math
from pathlib import Path

import numpy as np
import pytest
from fmpy import extract, read_model_description
from fmu_raw import ERROR, OK, Instance

from cosim.errors import ModelError, UsageError
from cosim.master import Runner
from cosim.native.build import write_fmu
from cosim.native.container import LONGEST, container
from cosim.native.package import write_native_ssp
from cosim.paths import ssp_folder

H = 1e-3
STEPS = 1500
PARAMETERS = {
    "mechanical.J": 900.0,
    "mechanical.tau_c": 60.0,
    "mechanical.gap": 1e-3,
    "sensor.tau_l": 0.03,
    "dcv.tau_d": 0.0105,
}


def command() -> tuple[np.ndarray, np.ndarray]:
    """Starts away from zero and takes both directions."""
    times = np.arange(STEPS + 1) * H
    return times, np.select([times < 0.5, times < 0.9], [0.3 + 0.3 * np.sin(5.0 * times), -0.6], -0.3)


def of_package(system: str, tmp_path: Path, parameters: dict[str, float]) -> dict[str, np.ndarray]:
    """Signals of the package of components under our master, by the container's names."""
    package = write_native_ssp(ssp_folder() / f"{system}.ssd", tmp_path / "open.ssp", open=True)
    with Runner(package) as runner:
        return runner.run(STEPS * H, H, parameters=parameters, inputs={"u": command()}).signals


@pytest.mark.parametrize("system", ["full_order", "physical", "simplified"])
def test_the_coupling_inside_is_that_of_our_master(chains, tmp_path, system) -> None:
    parameters = {n: v for n, v in PARAMETERS.items() if system != "simplified" or n.startswith("sensor")}
    expected = of_package(system, tmp_path, parameters)
    name = f"{system}_chain"
    with Runner(chains[system]) as runner:
        given = {f"{name}.{n}": v for n, v in parameters.items()}
        found = runner.run(STEPS * H, H, parameters=given, inputs={"u": command()}).signals
    model = container(ssp_folder() / f"{system}.ssd")
    outputs = {n: ".".join(model.places[n]) for n, _ in model.of("output")}
    assert set(outputs.values()) == {n for n in expected if "." in n}
    for output, signal in outputs.items():
        span = np.ptp(expected[signal]) or 1.0
        assert np.max(np.abs(found[f"{name}.{output}"] - expected[signal])) <= 1e-12 * span, output
    assert np.ptp(expected["sensor.slew"]) > 1e-3


def test_names_fit_into_simulink(chains) -> None:
    for file in chains.values():
        description = read_model_description(str(file))
        names = {v.name: v for v in description.modelVariables}
        assert max(map(len, names)) <= LONGEST
        assert [n for n, v in names.items() if v.causality == "input"] == ["u"]
        assert names["sensor.gain"].causality == "parameter"
        assert {"slew", "slew_estimate", "slew_rate_estimate", "compensator_demand"} <= set(names)
        direct = {u.variable.name: [d.name for d in u.dependencies] for u in description.outputs}
        assert direct["dead_zone_demand"] == ["u"]
        assert direct["slew"] == []


def test_values_of_a_fit_go_into_the_start_values(tmp_path) -> None:
    ssd = ssp_folder() / "full_order.ssd"
    model = container(ssd, "fitted", {"mechanical": {"J": 900.0, "theta_0": 0.1}})
    fmu = write_fmu(model, tmp_path / "fitted.fmu")
    slave = Instance(Path(extract(str(fmu), str(tmp_path / "unpacked")))).initialise()
    assert slave.get("mechanical.J", "theta", "slew") == [900.0, 0.1, 0.1]
    slave.close()
    with pytest.raises(UsageError, match="no component 'mechanics'; did you mean mechanical"):
        container(ssd, values={"mechanics": {"J": 1.0}})
    with pytest.raises(UsageError, match=r"mechanical\.J = 0\.0 kg\.m2 is not within"):
        container(ssd, values={"mechanical": {"J": 0.0}})


def test_an_input_within_is_checked_as_by_the_component_itself(chains, tmp_path) -> None:
    slave = Instance(Path(extract(str(chains["full_order"]), str(tmp_path / "unpacked"))), "chain")
    slave.initialise(**{"compensator.form": 2.0, "compensator.m_r": 1e-3, "compensator.limit": 100.0,
                        "dcv.K": 1.0, "dcv.x_max": 1.0, "continuity.K_c": 1e12})  # fmt: skip
    slave.set(u=1.0)
    status, k = OK, 0
    while status == OK and k < 2000:
        status = slave.step(k * H)
        k += 1
    assert status == ERROR
    assert "mechanical.p_load = " in slave.messages[0]
    assert "must be a number from -1000000000.0 to 1000000000.0" in slave.messages[0]
    assert all(map(math.isfinite, slave.get(*slave.outputs)))
    slave.close()


def test_states_hold_every_component(chains, tmp_path) -> None:
    folder = Path(extract(str(chains["physical"]), str(tmp_path / "unpacked")))
    slave, other = (
        Instance(folder).initialise(**{"dead_zone.play": 0.05, "dcv.tau_d": 0.02}),
        Instance(folder),
    )
    rows = [[math.sin(0.01 * k)] for k in range(200)]
    slave.play(rows[:100])
    data = slave.state_bytes()
    expected = slave.play(rows[100:], first=100)
    other.restore_bytes(data)
    assert other.play(rows[100:], first=100) == expected
    slave.close()
    other.close()


@pytest.mark.parametrize(
    ("old", "new", "text"),
    [
        ('endConnector="spool"', 'endConnector="spol"', "there is no input continuity.spol"),
        ('startConnector="spool"', 'startConnector="spol"', "there is no output dcv.spol"),
        ("resources/dcv.fmu", "resources/valve.fmu", "component 'dcv' runs resources/valve.fmu"),
        (
            'endElement="sensor" endConnector="theta"',
            'endElement="" endConnector="theta"',
            "nothing feeds sensor.theta",
        ),
    ],
)
def test_bad_wiring_is_refused(tmp_path, old, new, text) -> None:
    source = ssp_folder() / "full_order.ssd"
    words = source.read_text(encoding="utf-8")
    assert old in words
    (tmp_path / "nominal").symlink_to(source.parent / "nominal")
    bad = tmp_path / "bad.ssd"
    bad.write_text(words.replace(old, new, 1), encoding="utf-8")
    with pytest.raises(ModelError) as refusal:
        container(bad)
    assert text in str(refusal.value)
