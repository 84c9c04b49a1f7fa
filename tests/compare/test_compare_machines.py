"""Other machines through mapping files and SSPs alone; measured data where it is at hand."""

import json
import os
from pathlib import Path

import numpy as np
import pytest

from cosim.cli import main
from cosim.compare import Comparator, load_mapping, open_model
from cosim.errors import DataError, ModelError, UsageError
from cosim.logs import load_log
from cosim.paths import examples_folder

MODELS = examples_folder() / "models"
MEASURED = Path(os.environ.get("COSIM_DATA", Path(__file__).resolve().parents[3] / "shared" / "data"))
measured = [
    pytest.mark.data,
    pytest.mark.skipif(not MEASURED.is_dir(), reason="no measured data: set COSIM_DATA to their folder"),
]
AXIS = """
model = "axis.ssd"
[time]
column = "t"
unit = "s"
[signals.push]
column = "force"
unit = "N"
held = true
[signals.place]
column = "x"
unit = "mm"
[compare.signals.push]
variable = "{push}"
factor = "{factor}"
[compare.signals.place]
variable = "{place}"
factor = "1 rad/m"
[compare.start]
"{start}" = "place"
"""
NAMES = {"push": "p_load", "factor": "1 Pa/N", "place": "theta", "start": "mechanical.theta_0"}


@pytest.fixture(autouse=True)
def own_build(tmp_path, monkeypatch):
    monkeypatch.setenv("COSIM_BUILD", str(tmp_path / "build"))


@pytest.fixture
def axis(tmp_path):
    """A linear axis pushed by 100 N from x = 30 mm, solved by hand, with its wiring and mapping."""
    M, b, F = 95.109, 203.503, 100.0
    t = np.arange(2001) * 1e-3
    x = 30.0 + 1e3 * F / b * (t - M / b * (1.0 - np.exp(-b / M * t)))
    rows = "\n".join(f"{a:.3f},{F},{c!r}" for a, c in zip(t, x.tolist(), strict=True))
    (tmp_path / "log.csv").write_text(f"t,force,x\n{rows}\n")
    for name in ("ssd", "ssv"):
        text = (MODELS / f"emps.{name}").read_text(encoding="utf-8").replace("emps.ssv", "axis.ssv")
        (tmp_path / f"axis.{name}").write_text(text, encoding="utf-8")

    def write(**names):
        (tmp_path / "axis.toml").write_text(AXIS.format(**{**NAMES, **names}))
        return tmp_path / "axis.toml"

    write()
    write.folder = tmp_path
    return write


def opened(mapping):
    names, table = load_mapping(mapping)
    log = load_log(mapping.with_name("log.csv"), names)
    return Comparator(log, open_model(names.model, mapping.parent), table=table)


@pytest.mark.parametrize("names", [{}, {"push": "mechanical.p_load", "place": "mechanical.theta"}])
def test_a_foreign_system_needs_a_mapping_alone(axis, names):
    with opened(axis(**names)) as comparator:
        found = comparator.run({"mechanical.tau_c": 0.0, "mechanical.tau_load": 0.0})
    assert found.command == ("push",)
    assert [b.components for b in found.blocks] == [("mechanical",)]
    place = found.signals["place"]
    # in metres: the block is exact for a constant force, the start is found from a motion under way
    assert np.max(np.abs(place.measured - place.simulated)) < 1e-6
    assert place.score.rmse_windows < 1e-12
    assert not any("already moves" in note for note in found.notes)
    assert place.score.rmse_windows is not None
    assert found.shown("place") == ("mm", pytest.approx(1000.0))


def test_the_axis_starts_where_its_signal_does_unasked(axis):
    mapping = axis()
    mapping.write_text(mapping.read_text().split("[compare.start]")[0])
    with opened(mapping) as comparator:
        found = comparator.run({"mechanical.tau_c": 0.0, "mechanical.tau_load": 0.0})
    place = found.signals["place"]
    assert np.max(np.abs(place.measured - place.simulated)) < 1e-6


def test_a_connector_called_like_the_signal_is_it_where_the_mapped_block_is_gone(axis):
    """An extended model may have a linear one in the place of the blocks that the mapping names."""
    mapping = axis(place="block.gone")
    with pytest.raises(UsageError, match=r"'block\.gone' for the signal 'place'"):
        opened(mapping)
    wiring = axis.folder / "axis.ssd"
    text = wiring.read_text(encoding="utf-8")
    outside = '\n      <ssd:Connector name="theta"'
    assert text.count(outside) == text.count('endConnector="theta"') == 1
    text = text.replace(outside, outside.replace("theta", "place"))
    wiring.write_text(text.replace('endConnector="theta"', 'endConnector="place"'), encoding="utf-8")
    with opened(mapping) as comparator:
        place = comparator.run({"mechanical.tau_c": 0.0, "mechanical.tau_load": 0.0}).signals["place"]
    assert np.max(np.abs(place.measured - place.simulated)) < 1e-6


def test_factor_scales_the_drive(axis):
    with opened(axis(factor="2 Pa/N")) as comparator:
        free = {"mechanical.tau_c": 0.0, "mechanical.tau_load": 0.0}
        twice = comparator.simulate(free)["place"]
    with opened(axis()) as comparator:
        once = comparator.simulate(free)["place"]
    np.testing.assert_allclose(twice - twice[0], 2.0 * (once - once[0]), rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize(
    ("names", "message"),
    [
        ({"factor": "1 Pa"}, "compare.signals.push: factor"),
        ({"factor": "0 Pa/N"}, "leaves nothing"),
        ({"push": "mechanical.p_loud"}, "closest: 'mechanical.p_load'"),
        ({"place": "mechanical.J"}, "wrong dimension"),
        ({"place": "mechanical.theta_0"}, "needs a Real output or input"),
        ({"start": "mechanical.theta_1"}, "compare.start names 'mechanical.theta_1'"),
    ],
)
def test_wrong_tables_are_refused(axis, names, message):
    with pytest.raises(UsageError, match=message):
        opened(axis(**names))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[compare]\nsignal = 1", "'compare.signal'"),
        ("[compare.signals.push]\nfactor = '1'", "'compare.signals.push.variable': Field required"),
        ("[compare.signals.shove]\nvariable = 'p_load'", "shove"),
        ("compare = 3", "must be a table"),
        ("[compare]\n[tume]\ncolumn = 't'", "tume"),
    ],
)
def test_faults_in_the_mapping_file_name_the_key(axis, text, message):
    file = axis()
    plain = file.read_text().split("[compare.")[0]
    first = text if text.startswith("compare =") else ""
    file.write_text(first + "\n" + plain + ("" if first else text))
    with pytest.raises(DataError, match=message):
        opened(file)


def test_a_unit_that_does_not_fit_asks_for_a_factor(axis):
    file = axis()
    file.write_text(file.read_text().replace('factor = "1 Pa/N"\n', ""))
    with pytest.raises(UsageError, match=r"'push' \[N\] does not fit.*factor"):
        opened(file)


def test_bad_wiring_is_a_model_error(tmp_path):
    (tmp_path / "bad.ssd").write_text("<ssd")
    with pytest.raises(ModelError, match="well-formed"):
        open_model(str(tmp_path / "bad.ssd"))


def test_our_own_wiring_files_serve_as_models():
    package = open_model(str(Path(__file__).resolve().parents[2] / "ssp" / "simplified.ssd"))
    assert package.name == "simplified_open.ssp"
    assert package.is_file()


def command(capsys, *words):
    with pytest.raises(SystemExit) as stop:
        main(["compare", *map(str, words), "--json"])
    out = capsys.readouterr().out
    assert stop.value.code == 0, out
    return json.loads(out)


class TestMeasured:
    """Figures as docs/compare.md gives them; the bands allow for other compilers, not for other models."""

    pytestmark = measured

    @pytest.mark.parametrize(("file", "rmse"), [("DATA_EMPS", 6.63), ("DATA_EMPS_PULSES", 9.15)])
    def test_emps(self, capsys, file, rmse):
        found = command(capsys, MEASURED / "emps" / f"{file}.mat", "--mapping", MODELS / "emps.toml")
        position = found["signals"]["position"]
        assert position["unit"] == "mm"
        assert position["rmse"] == pytest.approx(rmse, rel=0.01)
        assert found["log"]["synthetic"] is False
        assert found["blocks"][0]["driven_by"] == ["force"]

    @pytest.mark.parametrize(
        ("file", "rmse", "windows"),
        [("manual_shyam_1101_2002", 11.5, 2.06), ("manual_1101_2326", 11.5, 2.85)],
    )
    def test_mini_excavator(self, capsys, file, rmse, windows):
        log = MEASURED / "mini_excavator" / f"{file}.csv"
        found = command(capsys, log, "--mapping", MODELS / "mini_excavator.toml", "--step-size", "20 ms")
        slew = found["signals"]["slew"]
        assert slew["rmse"] == pytest.approx(rmse, rel=0.02)
        assert slew["rmse_windows"] == pytest.approx(windows, rel=0.02)
        assert any("resampled" in note for note in found["notes"])
        assert found["model"]["parameters"]["simplified.k"] == 17.6
