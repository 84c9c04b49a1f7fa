"""A log can be held against a package of the user's own, with its own values."""

from pathlib import Path

import pytest

from cosim.diagnosis.model.choice import chosen
from cosim.diagnosis.model.machine import our_machine
from cosim.diagnosis.pipeline.diagnose import diagnose
from cosim.errors import ModelError, UsageError
from cosim.paths import ssp_folder
from cosim.rig import as_log, make_log
from cosim.ssp.write import write_as_wired, write_ssp


@pytest.fixture(scope="module")
def package(tmp_path_factory: pytest.TempPathFactory) -> Path:
    file = tmp_path_factory.mktemp("own") / "own.ssp"
    values = {"mechanical": {"tau_c": 100.0, "J": 900.0}}
    return write_ssp(ssp_folder() / "full_order.ssd", file, values=values, open=True)


def test_values_of_the_package_are_read(package: Path) -> None:
    assert chosen(str(package), None) == ("full_order", {"mechanical.tau_c": 100.0, "mechanical.J": 900.0})


def test_names_and_defaults() -> None:
    assert chosen(None, None) == ("full_order", {})
    assert chosen(None, "simplified") == ("simplified", {})
    with pytest.raises(UsageError, match="did you mean simplified"):
        chosen("simplifed", None)


def test_the_physical_structure_is_known(tmp_path: Path) -> None:
    values = {"continuity": {"C_L": 5e-12}}
    package = write_ssp(ssp_folder() / "physical.ssd", tmp_path / "p.ssp", values=values, open=True)
    name, base = chosen(str(package), None)
    assert name == "physical"
    assert base == {"continuity.C_L": 5e-12, "mechanical.b": our_machine("physical").base["mechanical.b"]}


def test_a_package_of_another_structure_is_refused(tmp_path: Path) -> None:
    axis = Path(__file__).parents[2] / "examples" / "models" / "emps.ssd"
    other = write_as_wired(axis, tmp_path / "p.ssp")
    with pytest.raises(ModelError, match="not those of a model"):
        chosen(str(other), None)
    with pytest.raises(ModelError):
        chosen(str(tmp_path / "none.ssp"), None)


@pytest.mark.slow
def test_what_the_package_has_right_is_no_cause_and_what_it_has_wrong_is(package: Path) -> None:
    log = as_log(make_log("steps", 20.0, ["mechanical.coulomb_friction:tau_c=100 N.m"], seed=3))
    model, base = chosen(str(package), None)
    found = diagnose(log, model=model, base=base)
    assert [c.effect.name for c in found.causes] == ["mechanical.inertia"]
    assert found.values["mechanical.J"] == pytest.approx(763.94, rel=0.03)
    assert found.values["mechanical.tau_c"] == 100.0
