"""`cosim init` for a model and a log that Simulink wrote: its structures, timeseries and arrays."""

import csv
import warnings
from pathlib import Path

import numpy as np
import pytest
import systems
from scipy.io import savemat

from benchmarks.systems import parts
from cosim.anysystem.start import mapping_text
from cosim.logs import load_mapping
from cosim.logs.load import load_log
from cosim.ssp.read import read_system

with warnings.catch_warnings():
    warnings.simplefilter("ignore")
    matio = pytest.importorskip("matio")
    from matio.utils.matclass import MatlabOpaque

CONNECTORS = ("command", "valve.y", "plant.y")
STEP = 0.013  # none that would be proposed where nothing is known


@pytest.fixture(scope="module")
def recorded(tmp_path_factory) -> dict[str, np.ndarray]:
    """Connector -> readings."""
    path = systems.log(tmp_path_factory.mktemp("simulink") / "log.csv", [], 2)
    with path.open(newline="") as file:
        table = np.array(list(csv.reader(file))[1:], dtype=float)
    return {name: table[:, k + 1] for k, name in enumerate(CONNECTORS)}


def stamps(recorded):
    return STEP * np.arange(recorded["command"].size)


def structure(time, signals):
    """A structure with time as `To Workspace` and a model's `yout` have it: each signal a dict of its fields."""
    kinds = [(key, object) for key in signals[0]]
    fields = np.array([tuple(signal.values()) for signal in signals], dtype=kinds)
    return {"time": time[:, None], "signals": fields, "blockName": "model/To Workspace"}


def signal(values, **fields):
    return {"values": values.reshape(len(values), -1), "dimensions": 1.0, **fields}


def labelled(recorded):
    names = ("command", "valve out", "plant_y")
    made = [signal(v, label=name) for name, v in zip(names, recorded.values(), strict=True)]
    return {"simout": structure(stamps(recorded), made)}


def of_ports(recorded):
    blocks = ("model/command", "model/valve\ny", "model/plant_y")
    made = [signal(v, label="", blockName=block) for block, v in zip(blocks, recorded.values(), strict=True)]
    return {"yout": structure(stamps(recorded), made)}


def of_variables(recorded):
    names = ("command", "valve_y", "plant_y")
    return {
        name: structure(stamps(recorded), [signal(v, label="")])
        for name, v in zip(names, recorded.values(), strict=True)
    }


def arrays(recorded):
    names = ("u", "valve_y", "plant_y")
    columns = {name: v[:, None] for name, v in zip(names, recorded.values(), strict=True)}
    return {"tout": stamps(recorded)[:, None], **columns}


@pytest.mark.parametrize("layout", [labelled, of_ports, of_variables, arrays])
def test_signals_are_matched_by_their_own_names_and_keep_their_stamps(
    layout, native: Path, recorded, tmp_path: Path, command
) -> None:
    path = tmp_path / "run.mat"
    savemat(path, layout(recorded))
    code, out, err = command("init", native, path)
    assert code == 0, err
    assert "step =" not in path.with_suffix(".toml").read_text()
    assert not any(f"time -> {name}" in out for name in CONNECTORS), "stamps are no signal"
    log = load_log(path, path.with_suffix(".toml"))
    np.testing.assert_allclose(log.time, stamps(recorded))
    for name, values in recorded.items():
        np.testing.assert_array_equal(log[name], values)


def test_a_name_is_shown_without_the_path_that_simulink_gives_it(
    native: Path, recorded, tmp_path: Path, command
) -> None:
    path = tmp_path / "run.mat"
    savemat(path, of_ports(recorded))
    out = command("init", native, path)[1]
    assert out.splitlines()[:3] == ["command -> command", "valve y -> valve.y", "plant_y -> plant.y"]


def timeseries(values, time):
    info = {"Units": np.array(["seconds"])}
    return MatlabOpaque(
        {
            "Data_": values,
            "Time_": time[:, None],
            "TimeInfo": MatlabOpaque(info, "tsdata.timemetadata"),
            "DataInfo": MatlabOpaque({"Units": np.array([""])}, "tsdata.datametadata"),
        },
        "timeseries",
    )


@pytest.mark.parametrize("form", ["time first", "time last"])
def test_a_timeseries_of_a_vector_has_a_column_for_each_element(form, recorded, tmp_path: Path) -> None:
    both = np.column_stack([recorded["valve.y"], recorded["plant.y"]])
    data = both if form == "time first" else both.T.reshape(2, 1, -1)
    path = tmp_path / "run.mat"
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        content = {"logs": {"outputs": timeseries(data, stamps(recorded))}}
        matio.save_to_mat(str(path), content, version="v7")
    mapping = tmp_path / "run.toml"
    mapping.write_text(
        '[time]\ncolumn = "logs.outputs(1)"\nunit = "s"\n'
        '[signals.one]\ncolumn = "outputs(1)"\nunit = "1"\n[signals.two]\ncolumn = "outputs(2)"\nunit = "1"\n'
    )
    log = load_log(path, mapping)
    np.testing.assert_array_equal(log["one"], recorded["valve.y"])
    np.testing.assert_array_equal(log["two"], recorded["plant.y"])
    np.testing.assert_allclose(log.time, stamps(recorded))


def test_a_vector_in_a_structure_has_a_column_for_each_element(recorded, tmp_path: Path) -> None:
    both = np.column_stack([recorded["valve.y"], recorded["plant.y"]])
    path = tmp_path / "run.mat"
    savemat(path, {"simout": structure(stamps(recorded), [signal(both, label="both")])})
    mapping = tmp_path / "run.toml"
    mapping.write_text(
        '[time]\ncolumn = "simout.time"\nunit = "s"\n[signals.two]\ncolumn = "both(2)"\nunit = "1"\n'
    )
    np.testing.assert_array_equal(load_log(path, mapping)["two"], recorded["plant.y"])


def test_an_array_without_name_stands_for_the_output_of_one_fmu(recorded, tmp_path: Path) -> None:
    if parts.COMPILER is None:
        pytest.skip("no C compiler")
    fmu = parts.native("lag", tmp_path)
    path = tmp_path / "run.mat"
    savemat(
        path,
        {"tout": stamps(recorded)[:, None], "yout": recorded["valve.y"][:, None], "u": recorded["command"]},
    )
    with read_system(fmu) as system:
        text, told, open_, _ = mapping_text(system, fmu, path, tmp_path)
    (component,) = {line.partition(" -> ")[2].partition(".")[0] for line in told if line.startswith("yout")}
    assert f"yout -> {component}.y (by its place among the outputs: CHECK)" in told
    assert "by its place among the outputs: CHECK" in text
    assert open_ == []


def test_a_german_heading_is_a_time_and_its_units_are_those_of_a_mapping(
    native: Path, recorded, tmp_path: Path, command
) -> None:
    path = tmp_path / "messung.csv"
    rows = [
        ";".join(f"{x:.9g}".replace(".", ",") for x in row)
        for row in zip(1e3 * stamps(recorded), *recorded.values(), strict=True)
    ]
    path.write_text(
        "Zeit (ms);Command (-);valve_y (-);plant_y (Prozent)\n" + "\n".join(rows) + "\n", encoding="cp1252"
    )
    code, _, err = command("init", native, path)
    assert code == 0, err
    log = load_log(path, path.with_suffix(".toml"))
    np.testing.assert_allclose(log.time, stamps(recorded), rtol=1e-6)
    assert load_mapping(path.with_suffix(".toml")).signals["plant.y"].unit == "%"


def test_a_ramp_that_is_called_like_a_connector_is_no_time(native: Path, tmp_path: Path, command) -> None:
    path = tmp_path / "ramp.csv"
    path.write_text("command,plant_y\n" + "".join(f"{k / 50},{k % 7}\n" for k in range(80)))
    code, out, err = command("init", native, path)
    assert code == 0, err
    assert "command -> command" in out
    assert "step = 0.001    # CHECK" in path.with_suffix(".toml").read_text()


def test_info_says_that_each_signal_has_its_own_stamps(recorded, tmp_path: Path, command) -> None:
    path = tmp_path / "run.mat"
    savemat(path, labelled(recorded))
    out = " ".join(command("info", path)[1].split())
    assert "no gap; each column has stamps of its own; " in out
