"""Native FMUs under the contract suite of the Python FMUs: the same numbers, reset, many instances, jitter, saved states."""

import re
import subprocess
import sys
import zipfile
from pathlib import Path

import numpy as np
import pytest
from fmpy import extract, read_model_description
from fmpy.validation import validate_fmu
from fmu_raw import Instance
from lxml import etree
from test_fmu_run import (  # the tests themselves, with this folder's fixtures
    effects_on,
    inputs_of,
    test_a_state_restored_continues_bit_for_bit,
    test_a_stimulus_can_start_later,
    test_an_initialisation_mode_reads_what_was_set,
    test_bit_for_bit_what_the_equations_compute,
    test_instances_do_not_know_each_other,
    test_jitter_of_a_masters_clock_changes_nothing,
    test_reset_restores_everything,
    test_simulate_fmu_gives_every_row,
    test_steps_of_any_length_in_turn,
)

from cosim.errors import UsageError
from cosim.native.build import build_native, entries
from cosim.native.model import single
from fmus.build import composed_block
from fmus.describe import model_description

__all__ = [
    "test_a_state_restored_continues_bit_for_bit",
    "test_a_stimulus_can_start_later",
    "test_an_initialisation_mode_reads_what_was_set",
    "test_bit_for_bit_what_the_equations_compute",
    "test_instances_do_not_know_each_other",
    "test_jitter_of_a_masters_clock_changes_nothing",
    "test_reset_restores_everything",
    "test_simulate_fmu_gives_every_row",
    "test_steps_of_any_length_in_turn",
]

RESUME = """
import sys, numpy as np
from pathlib import Path
sys.path[:0] = sys.argv[3:5]
from fmu_raw import Instance
s = Instance(Path(sys.argv[1]))
s.restore_bytes(Path(sys.argv[2], "state").read_bytes())
np.save(Path(sys.argv[2], "found.npy"), s.play(np.load(Path(sys.argv[2], "rows.npy")), first=50))
"""


def test_fmpy_finds_nothing_wrong(fmu_files, name) -> None:
    assert validate_fmu(str(fmu_files[name])) == []


def test_fmpy_finds_nothing_wrong_with_the_chains(chains) -> None:
    assert {name: validate_fmu(str(file)) for name, file in chains.items()} == {n: [] for n in chains}


def test_the_description_is_that_of_the_python_twin(fmu_files, name) -> None:
    """Variables, units, structure: a package swaps one for the other."""
    with zipfile.ZipFile(fmu_files[name]) as archive:
        native = etree.fromstring(
            archive.read("modelDescription.xml"), etree.XMLParser(remove_blank_text=True)
        )
    python = model_description(composed_block(name), {}, b"")
    count = len(python.find("ModelVariables"))  # states and derivatives for model exchange come behind
    for node in native.find("ModelVariables")[count:]:
        assert node.get("causality") == "local"
        node.getparent().remove(node)
    known = {unit.get("name") for unit in python.find("UnitDefinitions")}
    for tag in ("ModelVariables", "UnitDefinitions", "DefaultExperiment"):
        one, other = native.find(tag), python.find(tag)
        for unit in [u for u in one if u.tag == "Unit" and u.get("name") not in known]:
            one.remove(unit)
        assert etree.tostring(one, method="c14n") == etree.tostring(other, method="c14n"), tag
    for one, other in zip(
        native.find("ModelStructure/Outputs"), python.find("ModelStructure/Outputs"), strict=True
    ):
        depends = [place for place in one.get("dependencies").split() if int(place) <= count]
        assert (one.get("index"), depends) == (other.get("index"), other.get("dependencies").split())
    slave = native.find("CoSimulation")
    assert slave.get("modelIdentifier") == name
    assert [slave.get(f) for f in ("needsExecutionTool", "canInterpolateInputs")] == ["false", "true"]


def test_nothing_of_python_is_needed(fmu_files, name) -> None:
    """Neither a script among the resources nor a symbol of the interpreter in the library."""
    with zipfile.ZipFile(fmu_files[name]) as archive:
        names = archive.namelist()
        (library,) = [n for n in names if n.startswith("binaries/")]
        assert not re.search(rb"_Py_|PyObject|libpython", archive.read(library))
    assert not [n for n in names if n.endswith(".py") or n == "resources/slavemodule.txt"]
    assert {"sources/fmu.c", "sources/model.h", "sources/buildDescription.xml"} <= set(names)


def test_building_again_gives_the_same_bytes(fmu_files, tmp_path) -> None:
    """The library aside, which is the compiler's matter, though this one keeps to it."""
    found = entries(single(composed_block("dcv"), {}), {})
    again = entries(single(composed_block("dcv"), {}), {})
    assert found == again
    changed = entries(single(composed_block("dcv"), {"K": 2.4e-3}), {})
    guids = [etree.fromstring(e["modelDescription.xml"]).get("guid") for e in (found, changed)]
    assert guids[0] != guids[1], "another start value is another FMU"


def test_the_guid_does_not_depend_on_speed(fmu_files, tmp_path) -> None:
    quick = read_model_description(str(fmu_files["dcv"])).guid
    fast = build_native(composed_block("dcv"), tmp_path / "dcv.fmu", optimise="-O2")
    assert read_model_description(str(fast)).guid == quick


def test_start_values_are_checked_as_for_the_twin(tmp_path) -> None:
    with pytest.raises(UsageError, match=r"mechanical\.J = -1\.0 kg\.m2 is not within"):
        build_native(composed_block("mechanical"), tmp_path / "m.fmu", {"J": -1.0})


def test_other_start_values_and_resources(unpacked, tmp_path) -> None:
    table = b"time,u\n0,0.125\n"
    other = build_native(
        composed_block("stimulus"), tmp_path / "stimulus.fmu", {"gain": 2.0}, {"stimulus.csv": table}
    )
    # characters under which FMUs of pythonfmu crash
    folder = Path(extract(str(other), str(tmp_path / "a #%20+(é) b")))
    one, two = Instance(unpacked["stimulus"]).initialise(), Instance(folder).initialise()
    assert one.play([[]] * 200)[-1] == [1.0]
    assert two.play([[]] * 200)[-1] == [0.25]


def test_a_state_travels_to_another_process(unpacked, tmp_path) -> None:
    rows = inputs_of("mechanical", 100)
    slave = Instance(unpacked["mechanical"]).initialise(**effects_on("mechanical"))
    slave.play(rows[:50])
    (tmp_path / "state").write_bytes(slave.state_bytes())
    np.save(tmp_path / "rows.npy", rows[50:])
    expected = slave.play(rows[50:], first=50)
    here = Path(__file__).resolve()
    command = [sys.executable, "-c", RESUME, str(unpacked["mechanical"]), str(tmp_path)]
    command += [str(here.parents[1] / "fmus"), str(here.parents[2])]
    subprocess.run(command, check=True, capture_output=True)
    assert np.array_equal(np.load(tmp_path / "found.npy"), expected)
    slave.close()


def test_a_hundred_instances_at_once(unpacked) -> None:
    """Each knows its own state alone; freeing all gives the memory back to the process."""
    slaves = [Instance(unpacked["dcv"], f"s{k}") for k in range(100)]
    for k, slave in enumerate(slaves):
        slave.initialise(K=1e-3 * (1.0 + k))
    ends = [slave.play([[0.01]] * 200)[-1][0] / (1.0 + k) for k, slave in enumerate(slaves)]
    for slave in slaves:
        slave.close()
    assert np.ptp(ends) < 1e-12 * abs(ends[0])
