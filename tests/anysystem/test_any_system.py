"""`cosim diagnose` on a system of strangers: what is hidden is named at its connector, a clean log is adequate."""

import json
import re
from pathlib import Path

import numpy as np
import pytest
import systems

from benchmarks.systems import parts
from benchmarks.systems.truth import Hidden, read, simulate


def diagnosed(command, log: Path, model: Path, tmp_path: Path, *words) -> dict:
    """The answer of the command line."""
    code, out, err = command("diagnose", log, "--model", model, "--out", tmp_path / "out", "--json", *words)
    assert code == 0, err
    return json.loads(out)


def test_a_clean_log_is_adequate(native: Path, command, tmp_path: Path) -> None:
    found = diagnosed(command, systems.log(tmp_path / "log.csv", [], 1), native, tmp_path)
    assert found["verdict"] == "adequate"
    assert found["causes"] == []
    assert found["unexplained"] == []


@pytest.mark.parametrize(
    ("hidden", "parameter", "tolerance"),
    [
        (Hidden("port.dead_zone", "plant.u", "input", {"low": -0.2, "high": 0.3}), "high", 0.05),
        (Hidden("port.saturation", "valve.u", "input", {"low": -0.6, "high": 0.5}), "low", 0.05),
        (Hidden("port.gain", "valve.y", "output", {"gain": 1.15}), "gain", 0.02),
    ],
    ids=lambda item: item.effect if isinstance(item, Hidden) else None,
)
def test_a_hidden_effect_is_named_at_its_connector(
    native: Path, command, tmp_path: Path, hidden: Hidden, parameter: str, tolerance: float
) -> None:
    log = systems.log(tmp_path / "log.csv", [hidden], 2)
    found = diagnosed(command, log, native, tmp_path, "--budget", "10min")
    assert found["verdict"] == "explained"
    assert not [w for w in found["warnings"] if "not tried" in w], "there was time enough"
    (cause,) = found["causes"]
    assert cause["effect"] == hidden.effect
    assert f"{cause['component']}.{cause['connector']}" == hidden.port
    assert cause["where"] == hidden.where
    told = cause["parameters"][parameter]
    assert told["value"] == pytest.approx(hidden.values[parameter], rel=tolerance)
    assert told["ci95"][0] < told["value"] < told["ci95"][1]
    assert found["localisation"][0]["block"] == cause["component"]
    page = (tmp_path / "out" / "report.html").read_text()
    assert "Where it goes wrong" not in page, "of FMUs nothing is drawn there"
    other = next(name for name in ("valve", "plant") if name != cause["component"])
    blocks = dict(re.findall(r'<a class="block[^>]*><b>(.*?)</b><span>(.*?)</span>', page))
    assert blocks == {cause["component"]: "100 % of the error", other: "within noise"}
    assert [*blocks] == ["valve", "plant"], "in the order of the signals"
    assert '<span class="wire">command</span>' in page
    for text in (
        cause["effect"],
        f"{told['value']:.3g}"[:4],
        "plant.y [1]",
        "with the causes",
        "No further run is needed",
        "What it explains",
        "on data not used for fitting falls from",
    ):
        assert text in page
    assert "Error of the valve.y" not in page
    assert "under suspicion by name" not in page  # a cause is named
    assert "(port)" not in page
    assert "http://" not in page.partition("<script>")[0]


@pytest.mark.slow
def test_the_interval_from_several_logs_holds_what_changes_between_them(
    native: Path, command, tmp_path: Path
) -> None:
    gains = (1.28, 1.3, 1.32)
    logs = [
        systems.log(tmp_path / f"{k}.csv", [Hidden("port.gain", "plant.u", "input", {"gain": gain})], k)
        for k, gain in enumerate(gains)
    ]
    found = diagnosed(command, logs[0], native, tmp_path, *logs[1:])
    (cause,) = found["causes"]
    assert cause["effect"] == "port.gain"
    low, high = cause["parameters"]["gain"]["ci95"]
    assert low < 1.285
    assert high > 1.315


def test_a_reading_that_is_off_is_told_from_an_output_by_what_it_drives(
    native: Path, command, tmp_path: Path
) -> None:
    hidden = Hidden("port.gain", "valve.y", "sensor", {"gain": 1.15})
    found = diagnosed(command, systems.log(tmp_path / "log.csv", [hidden], 3), native, tmp_path)
    (cause,) = found["causes"]
    assert (cause["component"], cause["connector"], cause["where"]) == ("valve", "y", "sensor")
    assert not any("valve.y (output)" in other for other in cause["indistinguishable_from"])


def test_a_wrong_reading_in_a_loop_is_one_cause_and_no_second_one_in_what_it_drives(
    command, tmp_path: Path
) -> None:
    if parts.COMPILER is None:
        pytest.skip("no C compiler")
    kinds = {"first": "sum", "second": "lag"}
    values = {"first": {"K": 1.0, "C": -0.8, "T": 0.1}, "second": {"K": 1.0, "T": 0.3}}
    wires = [("command", "first.u"), ("second.y", "first.v2"), ("first.y", "second.u")]
    model = parts.write_ssp(
        tmp_path / "loop.ssp", {n: parts.native(k, tmp_path) for n, k in kinds.items()}, wires, values
    )
    hidden = [Hidden("port.gain", "second.y", "sensor", {"gain": 1.2})]
    rng = np.random.default_rng(5)
    true = simulate(kinds, values, wires, {"command": systems.command(rng)}, systems.H, hidden)
    signals = read(true, hidden, systems.H, 0.01, rng)
    log, columns = tmp_path / "log.csv", ("command", "first.y", "second.y")
    table = np.column_stack([systems.H * np.arange(systems.COUNT), *(signals[n] for n in columns)])
    np.savetxt(
        log,
        table,
        "%.12g",
        delimiter=",",
        header=",".join(["time [s]", *(f"{n} [1]" for n in columns)]),
        comments="",
    )
    found = diagnosed(command, log, model, tmp_path)
    (cause,) = found["causes"]
    assert (cause["effect"], cause["component"], cause["where"]) == ("port.gain", "second", "sensor")
    assert cause["parameters"]["gain"]["value"] == pytest.approx(1.2, rel=0.01)


@pytest.mark.parametrize(
    ("port", "where", "size"),
    [pytest.param("plant.y", "output", 0.4, marks=pytest.mark.slow), ("plant.u", "input", 0.3)],
)
def test_what_is_not_in_the_vocabulary_stays_unexplained_and_its_port_and_function_are_told(
    native: Path, command, tmp_path: Path, port: str, where: str, size: float
) -> None:
    hidden = Hidden("strange.square", port, where, {"size": size})
    found = diagnosed(command, systems.log(tmp_path / "log.csv", [hidden], 4), native, tmp_path)
    assert found["verdict"] == "unexplained"
    (left,) = found["unexplained"]
    assert left["block"] == "plant"
    assert left["missing"]["enters_at"] == [f"{port} ({where})"]
    assert left["missing"]["depends_on"] == port
    assert left["missing"]["share"] > 0.9
    if where == "input":  # what is measured there is what the square is of
        points = left["missing"]["points"]
        reach = max(y for _, y in points) - min(y for _, y in points)
        for x, y in points:
            assert y == pytest.approx(size * x**2, abs=0.05 * reach)
    assert f"added at {port} ({where})" in left["what"]
    assert any("plant is trusted or free, so none could be named" in text for text in found["warnings"])
    assert not any("of its own" in text for text in found["warnings"])  # its steps can be halved
