"""An FMU that states no unit, as those of plain pythonfmu: the mapping says in which it counts, or is asked."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from cosim.anysystem.read import read
from cosim.anysystem.start import mapping_text
from cosim.browser.form import connector_form
from cosim.browser.mapping import mapping_of
from cosim.compare import Comparator, load_mapping
from cosim.errors import DataError
from cosim.logs.load import load_log
from cosim.logs.overview import overview
from cosim.ssp.read import read_system
from cosim.ssp.stated import unit_in_words

HEAD = """model = "{model}"
time = {{ column = "t", unit = "s" }}
[signals]
"command" = {{ column = "command [bar]", unit = "bar" }}
"plant.y" = {{ column = "plant.y [deg]", unit = "deg" }}
"""
STATED = '[compare.units]\n"command" = "bar"\n"plant.y" = "deg"\n'


def files(plain: Path, tmp_path: Path, more: str) -> tuple[Path, Path]:
    log, mapping = tmp_path / "log.csv", tmp_path / "log.toml"
    rows = "".join(f"{0.01 * k:.2f},{k % 7},{k % 5}\n" for k in range(200))
    log.write_text(f"t,command [bar],plant.y [deg]\n{rows}", encoding="utf-8")
    mapping.write_text(HEAD.format(model=plain.as_posix()) + more, encoding="utf-8")
    return log, mapping


def test_numbers_go_in_and_come_out_as_the_fmu_counts(plain: Path, tmp_path: Path) -> None:
    log, mapping = files(plain, tmp_path, STATED)
    with read_system(plain) as system:
        for _ in range(2):  # a second reading finds the units stated
            (found,), _, _ = read([log], system, mapping)
        assert found.signals["command"][:3] == pytest.approx([0.0, 1.0, 2.0])
        assert found.signals["plant.y"][:3] == pytest.approx([0.0, 1.0, 2.0])
        assert found.columns["plant.y"].unit == "deg"
        assert not [w for w in found.warnings if "unit" in w]
        wires = {str(w): w.factor for w in system.wires}
    with read_system(plain) as system:
        assert wires == {str(w): w.factor for w in system.wires}


@pytest.mark.parametrize("more", ["", STATED])
def test_a_comparison_counts_as_a_diagnosis_does(plain: Path, tmp_path: Path, more: str) -> None:
    log, mapping = files(plain, tmp_path, more)
    names, table = load_mapping(mapping)
    with read_system(plain) as system:
        (found,), _, _ = read([log], system, mapping)
    with Comparator(load_log(log, names), plain, table=table) as comparator:
        for name, values in found.signals.items():
            own = comparator.log[name] * comparator.bindings[name].gain
            assert np.allclose(own, values)
        for notes in (comparator.notes, found.warnings):
            assert any('"command" = "bar"' in n and "SI" in n for n in notes) == (not more)


def test_a_factor_counts_with_its_unit(plain: Path, tmp_path: Path) -> None:
    more = '[compare.signals."command"]\nvariable = "command"\nfactor = "2 1/bar"\n'
    log, mapping = files(plain, tmp_path, more)
    with read_system(plain) as system:
        (found,), _, _ = read([log], system, mapping)
    assert found.signals["command"][:3] == pytest.approx([0.0, 2.0, 4.0])
    assert not any("command" in w for w in found.warnings)


def test_what_is_wrong_with_a_stated_unit_is_said(plain: Path, tmp_path: Path) -> None:
    log, mapping = files(plain, tmp_path, '[compare.units]\n"plant.z" = "deg"\n"plant.y" = "degs of arc"\n')
    with read_system(plain) as system, pytest.raises(DataError) as error:
        read([log], system, mapping)
    assert "compare.units 'plant.z': the system has no variable of this name" in str(error.value)
    assert "compare.units 'plant.y': 'degs of arc' is not a unit" in str(error.value)


def test_a_first_mapping_says_in_which_unit_it_takes_the_fmu_to_count(plain: Path, tmp_path: Path) -> None:
    """As without a mapping: the log's numbers as they are."""
    log, _ = files(plain, tmp_path, "")
    with read_system(plain) as system:
        plant = system.components["plant"]
        said = replace(plant.fmu.variables["y"], description="angle of the boom [rad]")
        fmu = replace(plant.fmu, variables={**plant.fmu.variables, "y": said})
        system.components["plant"] = replace(plant, fmu=fmu)
        text, told, _, _ = mapping_text(system, plain, log, tmp_path)
    assert '"command" = "bar"    # taken from the log: CHECK' in text
    assert '"plant.y" = "rad"    # as its description says' in text
    assert any("command" in line and "CHECK" in line for line in told)


def test_the_page_writes_the_same(plain: Path, tmp_path: Path) -> None:
    log, _ = files(plain, tmp_path, "")
    found = overview(log)
    with read_system(plain) as system:
        form = connector_form(found, system)
    rows = {row.signal: {"column": row.column} for row in form.rows}
    made = mapping_of({"time": {"column": 0, "unit": "s"}, "rows": rows}, form, found, {})
    assert made["compare"] == {"units": {"command": "bar", "plant.y": "deg"}}
    assert made["signals"]["command"]["held"] is found.columns[1].held
    assert {row.check[:24] for row in form.rows if row.column is not None} == {"the FMU states no unit: "}


def test_a_comparison_takes_columns_called_like_connectors(command, plain: Path, tmp_path: Path) -> None:
    """It knew the crane's names alone without a mapping, where a diagnosis needed none."""
    log, mapping = files(plain, tmp_path, STATED)
    own = tmp_path / "own.csv"
    own.write_text(log.read_text().replace("t,command", "time [s],command", 1), encoding="utf-8")
    mapping.write_text(mapping.read_text().replace('column = "t"', 'column = "time [s]"'), encoding="utf-8")
    errors = []
    for words in (("--model", plain), ("--mapping", mapping)):
        code, out, err = command("compare", own, *words, "--json")
        assert code == 0, err
        errors.append(json.loads(out)["signals"]["plant.y"]["rmse"])
    assert errors[0] == pytest.approx(errors[1], rel=1e-6)


@pytest.mark.parametrize(
    ("text", "unit"),
    [("pressure [bar]", "bar"), ("speed (deg/s).", "deg/s"), ("the second [of two]", ""), ("plain", "")],
)
def test_a_description_that_ends_with_a_unit(plain: Path, text: str, unit: str) -> None:
    with read_system(plain) as system:
        variable = system.components["plant"].fmu.variables["y"]
    assert unit_in_words(replace(variable, description=text)) == unit
