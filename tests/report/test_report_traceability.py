"""An extended package says what its values rest on, by SSP Traceability, and its schemas agree."""

import zipfile
from pathlib import Path

import pytest

from cosim.diagnosis.answer.credibility import credited, sections
from cosim.diagnosis.answer.schema import Answer
from cosim.native.package import swapped
from cosim.ssp.check import check_ssp
from cosim.ssp.traceability import ENTRY, embedded
from cosim.ssp.write import write_archive


@pytest.fixture(scope="module")
def answer(diagnosed) -> Answer:
    """Coulomb friction of 150 N m, found."""
    return Answer.model_validate_json((diagnosed / "diagnosis.json").read_text(encoding="utf-8"))


@pytest.fixture
def package(diagnosed, answer, tmp_path) -> Path:
    """The extended package with its meta data."""
    file = tmp_path / "extended.ssp"
    plain = tmp_path / "plain.ssp"
    with zipfile.ZipFile(diagnosed / "extended.ssp") as archive:
        write_archive({n: archive.read(n) for n in archive.namelist() if n != ENTRY}, plain)
    credited({plain: file, diagnosed / "extended.ssv": tmp_path / "extended.ssv"}, answer)
    assert embedded(plain) is None
    assert (tmp_path / "extended.ssv").read_bytes() == (diagnosed / "extended.ssv").read_bytes()
    return file


def test_package_says_what_it_rests_on(package, answer) -> None:
    found = embedded(package)
    assert found == {n: s for n, s in sections(answer).items() if s}
    assert found["data"]["log_sha256"] == "ab" * 32
    assert found["diagnosis"]["verdict"] == answer.verdict
    [cause] = answer.causes
    value, unit = found["parameters"]["mechanical.tau_c.value"].split()
    low, high = map(float, found["parameters"]["mechanical.tau_c.ci95"].split())
    assert (float(value), unit) == (cause.parameters["tau_c"].value, "N.m")
    assert (low, high) == cause.parameters["tau_c"].ci95
    assert low < 150.0 < high
    assert found["parameters"]["mechanical.tau_c.cause"] == "mechanical.coulomb_friction"
    assert float(found["held-out-gain"]["slew.rmse_after"].split()[0]) == answer.gain["slew"].rmse_after
    assert set(found["tools"]) == {"cosim", "python", "numpy", "scipy", "numba", "fmpy", "pythonfmu"}


def test_meta_data_keeps_the_schema(package) -> None:
    xmlschema = pytest.importorskip("xmlschema")
    standard = pytest.importorskip("pyssp_standard")
    schema = xmlschema.XMLSchema11(str(Path(standard.__file__).parent / "resources" / "SRMD11.xsd"))
    with zipfile.ZipFile(package) as archive:
        text = archive.read(ENTRY).decode()
    schema.validate(text)
    assert not schema.is_valid(text.replace(' keyword="verdict"', ""))  # it would see a fault


def test_package_stays_what_it_was(package, diagnosed) -> None:
    assert check_ssp(package) == []
    with zipfile.ZipFile(package) as new, zipfile.ZipFile(diagnosed / "extended.ssp") as old:
        assert sorted(new.namelist()) == sorted({*old.namelist(), ENTRY})
        assert all(new.read(n) == old.read(n) for n in old.namelist() if n != ENTRY)


def test_same_answer_makes_the_same_bytes_and_replaces_what_was_there(package, answer) -> None:
    before = package.read_bytes()
    credited({package: package}, answer)
    assert package.read_bytes() == before
    other = answer.model_copy(update={"verdict": "partly_explained"})
    credited({package: package}, other)
    assert embedded(package)["diagnosis"]["verdict"] == "partly_explained"


@pytest.mark.slow
def test_native_package_carries_it_on(package, tmp_path) -> None:
    from cosim.native.build import MissingCompilerError

    try:
        native = swapped(package, tmp_path / "native.ssp")
    except MissingCompilerError as error:
        pytest.skip(str(error))
    assert embedded(native) == embedded(package)


def test_package_without_meta_data_has_none(packages) -> None:
    assert embedded(packages["simplified"]) is None
