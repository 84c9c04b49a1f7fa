import json
import re
import shutil
import sys
from dataclasses import replace

import numpy as np
import pytest
from report_helpers import friction_with_rest, hidden_material

from cosim.cli import main
from cosim.errors import DataError, MissingExtraError, UsageError
from cosim.report import overview
from cosim.report.folder import keep, load
from cosim.report.page import logs_of, page, write_report

LARGEST = 8e6  # bytes, of a report of 60 s at 1 kHz


@pytest.fixture
def copy(diagnosed, tmp_path):
    """A copy of the diagnosis folder that a test may damage."""
    return shutil.copytree(diagnosed, tmp_path / "diagnosis")


def own_text(folder) -> str:
    """The page without plotly and without the figures."""
    text = (folder / "report.html").read_text(encoding="utf-8")
    return re.sub(r"<script.*?</script>", "", text, flags=re.DOTALL)


def run(*words):
    with pytest.raises(SystemExit) as stop:
        main(["report", *map(str, words)])
    return stop.value.code


def test_the_head_names_the_logs_that_were_fitted():
    made = {"cosim": "1.0.0", "log": "out-50", "log_sha256": "0", "log_2": "out-70", "log_held_out": "out-90"}
    assert logs_of(made) == "out-50, out-70"
    assert logs_of(made | {"log_3": "in-50", "log_4": "in-70"}) == "out-50, out-70, in-50, …"
    assert logs_of({"cosim": "1.0.0"}) == "a log"


def test_the_report_says_what_was_found(diagnosed):
    text = own_text(diagnosed)
    assert "Coulomb friction" in text
    assert "is missing in the mechanics" in text
    assert "synthetic log" in text
    for heading in (
        "Measured against simulated",
        "Where it goes wrong",
        "Causes",
        "Nothing else is noticeable",
        "How it was made",
    ):
        assert heading in text
    assert "ab" * 32 in text  # the log's checksum


def test_the_report_escapes_what_it_did_not_write(diagnosed):
    assert "<b>rig" not in own_text(diagnosed)
    assert "&lt;b&gt;rig &amp; co" in own_text(diagnosed)


def test_the_report_refers_to_nothing_outside(diagnosed):
    text = own_text(diagnosed)
    assert not re.search(r"(?:src|href)\s*=\s*[\"'](?!#)", text)
    assert "default-src 'none'" in text
    assert "http:" not in text
    assert "https:" not in text


def test_a_minute_at_1_khz_stays_small(diagnosed):
    material = hidden_material("mechanical.coulomb_friction", duration=60.0)
    text = page(material)
    assert len(text.encode()) < LARGEST


def test_a_folder_gives_back_what_was_kept(diagnosed):
    material = load(diagnosed)
    assert material.answer.causes[0].effect == "mechanical.coulomb_friction"
    kinds = {
        "measured",
        "nominal",
        "extended",
        "block_nominal",
        "block_extended",
        "without mechanical.coulomb_friction",
    }
    assert kinds == set(material.series)
    again = diagnosed / "again"
    keep(material, again)
    shutil.copy(diagnosed / "diagnosis.json", again)
    second = load(again)
    assert second.parts.keys() == material.parts.keys()
    for kind, signals in material.series.items():
        for signal, values in signals.items():
            assert np.allclose(values, second.series[kind][signal], rtol=1e-6, atol=0.0)
    shutil.rmtree(again)


def test_before_and_after_are_the_fmus_and_after_is_better(diagnosed):
    series = load(diagnosed).series
    error = {k: np.std(series["measured"]["slew"] - series[k]["slew"]) for k in ("nominal", "extended")}
    assert error["extended"] < 0.3 * error["nominal"]


def test_the_same_folder_gives_the_same_page(copy):
    first = (copy / "report.html").read_bytes()
    write_report(copy)
    assert (copy / "report.html").read_bytes() == first


def test_the_command_makes_it_again(copy, capsys):
    (copy / "report.html").unlink()
    assert run(copy, "--json") == 0
    said = json.loads(capsys.readouterr().out)
    assert said["bytes"] == (copy / "report.html").stat().st_size


def test_a_folder_that_is_no_diagnosis_is_refused(tmp_path, capsys):
    assert run(tmp_path) == 3
    said = capsys.readouterr().err
    assert "diagnosis.json" in said
    assert "cosim diagnose" in said


@pytest.mark.parametrize("name", ["diagnosis.json", "comparison.parquet"])
@pytest.mark.parametrize("content", [b"", b"{}", b"[1, 2]", b"\xff\xfe\x00", b"PAR1junkPAR1"])
def test_a_damaged_file_is_named(copy, name, content):
    (copy / name).write_bytes(content)
    with pytest.raises(DataError, match=name.replace(".", r"\.")):
        load(copy)


def test_a_parquet_file_of_something_else_is_named(copy):
    import pandas as pd

    pd.DataFrame({"time [s]": [0.0, 1.0]}).to_parquet(copy / "comparison.parquet")
    with pytest.raises(DataError, match=r"comparison\.parquet"):
        load(copy)


def test_a_missing_extra_is_named(copy, monkeypatch):
    monkeypatch.setitem(sys.modules, "plotly", None)
    with pytest.raises(MissingExtraError, match="report"):
        write_report(copy)


def test_a_folder_that_cannot_be_written_is_named(copy):
    (copy / "report.html").unlink()
    (copy / "report.html").mkdir()
    with pytest.raises(UsageError, match=r"report\.html"):
        write_report(copy)


def test_what_stays_unexplained_is_drawn():
    text = page(friction_with_rest())
    assert "Unexplained in the mechanics" in text
    assert "Missing torque against slew angle" in text


def test_where_something_stays_unexplained_it_is_not_said_that_no_run_is_needed():
    """Of a heated plate that nothing explained: "No further run is needed to tell explanations apart."."""
    material = friction_with_rest()
    assert material.answer.unexplained
    material = replace(material, answer=material.answer.model_copy(update={"next_experiment": None}))
    text = page(material)
    assert "No further run is needed" not in text
    assert "No run is proposed" in text


def test_a_folder_of_a_diagnosis_beside_fmus_is_told(copy, capsys):
    (copy / "comparison.parquet").unlink()
    assert run(copy) == 3
    assert "beside FMUs keeps no series" in capsys.readouterr().err


def test_what_happened_once_is_drawn_from_near_and_weak_curves_are_not():
    material = friction_with_rest()
    curves = material.parts["mechanical"].after["slew"]
    curves[:] = [replace(curve, gain=4.0) for curve in curves]
    (rest,) = material.answer.unexplained
    assert "Missing torque against slew angle" not in page(material), "what gains 4 shows nothing"
    material.answer.unexplained[:] = [
        rest.model_copy(update={"what": "slew is off between 12.0 and 14.0 s only", "span": (12.0, 14.0)})
    ]
    assert "residual of the slew angle between 12.0 and 14.0 s" in page(material)
    (picture,) = overview.event(material, "mechanical", "slew is off", (12.0, 14.0), "rest-0")
    band, *lines = picture.panels[0].layers
    assert picture.shaded == [(12.0, 14.0)]
    assert band.x.tolist() == [9.0, 17.0]
    for line in lines:
        assert 9.0 <= np.nanmin(line.x) < 9.1
        assert 16.9 < np.nanmax(line.x) <= 17.0
    assert overview.event(material, "gearbox", "slew is off", (12.0, 14.0), "rest-0") == []


def test_numbers_that_could_not_be_computed_come_back_as_unknown(copy):
    data = json.loads((copy / "diagnosis.json").read_text(encoding="utf-8"))
    data["gain"]["slew"]["fit_percent_after"] = None
    data["causes"][0]["evidence"]["held_out_gain"] = None
    (copy / "diagnosis.json").write_text(json.dumps(data), encoding="utf-8")
    write_report(copy)
    assert "unknown" in own_text(copy)
