"""Packages of native FMUs: from the wiring, by swapping, from the command line, and unchanged in other masters."""

import json
import zipfile
from pathlib import Path

import numpy as np
import pytest
from lxml import etree
from test_clients import (  # the tests themselves, with this module's packages
    CHANGED,
    SIGNALS,
    command,
    installed,
    test_bindings_are_honoured_by_ecos_and_libcosim_and_ignored_by_the_others,
    test_nominal_and_extended_model_do_not_mix_in_one_process,
    test_system_agrees_with_the_blocks_under_the_master_s_scheme,
)
from typer.testing import CliRunner, Result

from benchmarks.engines import MODULES
from cosim.cli import make_app
from cosim.errors import ModelError, UsageError
from cosim.master import Runner
from cosim.native import build as native_build
from cosim.native.container import container
from cosim.native.package import swapped, values_of, write_native_ssp
from cosim.paths import ssp_folder
from cosim.ssp.stimulus import stimulus_csv
from cosim.ssp.write import write_archive, write_ssp
from fmus import registry

__all__ = [
    "test_bindings_are_honoured_by_ecos_and_libcosim_and_ignored_by_the_others",
    "test_nominal_and_extended_model_do_not_mix_in_one_process",
    "test_system_agrees_with_the_blocks_under_the_master_s_scheme",
]
FULL = ssp_folder() / "full_order.ssd"
# with FMUs of Python every client runs these in every run: here one that obeys bindings, and one that makes one FMU of all
QUICK = ("ecos", "fmucontainer")


@pytest.fixture(params=[pytest.param(e, marks=() if e in QUICK else pytest.mark.slow) for e in MODULES])
def engine(request) -> str:
    """A client."""
    return installed(request.param)


@pytest.fixture(scope="session")
def packages(tmp_path_factory) -> dict[str, Path]:
    """The packages of tests/clients, of native FMUs."""
    folder = tmp_path_factory.mktemp("packages")
    stimulus = stimulus_csv(*command())
    written = {
        name: write_native_ssp(ssp_folder() / f"{name}.ssd", folder / f"{name}.ssp", stimulus=stimulus)
        for name in SIGNALS
    }
    extended = write_native_ssp(FULL, folder / "extended.ssp", stimulus=stimulus, values=CHANGED)
    with zipfile.ZipFile(written["full_order"]) as nominal, zipfile.ZipFile(extended) as other:
        mixed = {name: nominal.read(name) for name in nominal.namelist()}
        mixed |= {name: other.read(name) for name in other.namelist() if name.endswith(".ssv")}
    return written | {"extended": extended, "bound": write_archive(mixed, folder / "bound.ssp")}


@pytest.fixture(scope="module")
def python_package(tmp_path_factory) -> Path:
    """An extended package as `cosim diagnose` writes it."""
    folder = tmp_path_factory.mktemp("python")
    values = {"mechanical": {"tau_c": 80.0, "J": 801.0}, "dead_zone": {"play": 0.02}}
    return write_ssp(FULL, folder / "extended.ssp", stimulus=stimulus_csv(*command()), values=values)


def test_swapping_the_fmus_gives_what_the_wiring_gives(python_package, tmp_path) -> None:
    values = {"mechanical": {"tau_c": 80.0, "J": 801.0}, "dead_zone": {"play": 0.02}}
    expected = write_native_ssp(FULL, tmp_path / "n.ssp", stimulus=stimulus_csv(*command()), values=values)
    assert swapped(python_package, tmp_path / "s.ssp").read_bytes() == expected.read_bytes()
    assert swapped(tmp_path / "s.ssp", tmp_path / "again.ssp").read_bytes() == expected.read_bytes()


def test_swapping_takes_values_into_fmus_and_bindings(python_package, tmp_path) -> None:
    changed = swapped(
        python_package, tmp_path / "c.ssp", {"mechanical": {"J": 950.0}, "sensor": {"bias": 0.01}}
    )
    with Runner(changed) as runner:
        found = runner.run(0.05, 1e-3, record=["sensor.slew"])
        assert runner.system.components["mechanical"].starts["J"] == 950.0
        assert runner.system.components["mechanical"].starts["tau_c"] == 80.0
        assert runner.system.components["mechanical"].fmu.variables["J"].start == 950.0
    assert found.signals["sensor.slew"][0] == 0.01
    with pytest.raises(UsageError, match="no component 'mechanic'"):
        swapped(python_package, tmp_path / "c.ssp", {"mechanic": {"J": 950.0}})
    with pytest.raises(UsageError, match="mechanical has no 'Jay'"):
        swapped(python_package, tmp_path / "c.ssp", {"mechanical": {"Jay": 950.0}})


def test_the_values_of_a_package_make_a_chain(python_package) -> None:
    found = values_of(python_package)
    assert found["mechanical"] == {"J": 801.0, "tau_c": 80.0}
    assert found["dead_zone"] == {"play": 0.02}
    assert found["compensator"] == {"form": 3.0, "limit": 2.0}
    starts = container(FULL, values=found).starts
    assert (starts["mechanical.tau_c"], starts["dead_zone.play"], starts["compensator.form"]) == (
        80.0,
        0.02,
        3.0,
    )
    assert "stimulus" not in found


def described(fmu: Path, change) -> Path:
    """A copy of an FMU with another description."""
    with zipfile.ZipFile(fmu) as archive:
        entries = {n: archive.read(n) for n in archive.namelist()}
    root = etree.fromstring(entries["modelDescription.xml"])
    change(root)
    entries["modelDescription.xml"] = etree.tostring(root)
    return write_archive(entries, fmu.with_name("changed.fmu"))


def test_fmus_of_others_and_of_other_effects_are_refused(fmu_files, tmp_path) -> None:
    other = described(fmu_files["sensor"], lambda root: root.set("generationTool", "a tool"))
    with pytest.raises(ModelError, match=r"changed\.fmu is no FMU of this project \('sensor' by a tool\)"):
        swapped(other, tmp_path / "out.fmu")

    def without_one(root: etree._Element) -> None:
        root.set("generationTool", "slew-cosim with pythonfmu")
        variables = root.find("ModelVariables")
        variables.remove(variables[-1])

    with pytest.raises(ModelError, match=r"made with other effects than those installed here \(quantum\)"):
        swapped(described(fmu_files["sensor"], without_one), tmp_path / "out.fmu")


# The command line


def cosim(*arguments: object) -> Result:
    return CliRunner().invoke(make_app(), [*map(str, arguments)], catch_exceptions=False)


def test_simulate_native_gives_the_same_numbers(python_package, tmp_path) -> None:
    tables = []
    for extra in ([], ["--native"]):
        out = tmp_path / f"{len(extra)}.csv"
        done = cosim(
            "simulate",
            python_package,
            "--stop-time",
            "0.3 s",
            "--set",
            "mechanical.J=850 kg.m2",
            "--out",
            out,
            *extra,
        )
        assert done.exit_code == 0, done.output
        tables.append(np.loadtxt(out, delimiter=",", skiprows=1))
    python, native = tables
    span = np.ptp(python, axis=0)
    assert np.all(np.abs(python - native) <= 1e-12 * np.maximum(span, 1e-300))
    assert python.shape[0] == 301


def test_build_native_builds_blocks_chains_and_packages(tmp_path) -> None:
    done = cosim("build", "--native", "--out", tmp_path, "--json")
    assert done.exit_code == 0, done.output
    found = json.loads(done.stdout)
    names = [Path(f).relative_to(tmp_path).as_posix() for f in (*found["fmus"], *found["ssp"])]
    assert "native/fmus/dcv.fmu" in names
    assert "native/fmus/full_order_chain.fmu" in names
    assert "native/ssp/physical_open.ssp" in names
    assert len(names) == len(registry.BLOCKS) + 3 + 9
    for name in names:
        assert (tmp_path / name).stat().st_size > 10000


def test_without_a_compiler_the_message_says_what_to_do(monkeypatch, tmp_path) -> None:
    monkeypatch.delenv("CC", raising=False)
    monkeypatch.setattr(native_build.shutil, "which", lambda name: None)
    with pytest.raises(
        native_build.MissingCompilerError, match=r"such as gcc or the extra `cross` .*, or set CC"
    ) as missing:
        native_build.compiler()
    assert missing.value.exit_code == 5
    monkeypatch.setenv("CC", "nocc -m64")
    with pytest.raises(native_build.MissingCompilerError, match="CC names 'nocc -m64'"):
        native_build.compiler()
