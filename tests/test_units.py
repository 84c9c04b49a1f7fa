"""Units: what is read, what is refused, and that nothing a user types gets further than a UsageError."""

import math
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from cosim.compare.mapping import load_mapping
from cosim.errors import UsageError
from cosim.logs.load import load_log
from cosim.ssp.quantities import of_reading
from cosim.units import base_exponents, factor, fmi_to_pint, parse_quantity, parse_unit, registry

ODD = [
    "((", "m/", "9**9**9", "m**9**9", "m**(9**9)", "(m**99)**99**99", "1/0", "0 m", "10 m", "1e-3 m", "m//s", "m%s", "**",
    "#", "__import__('os')", "m+s", "[x]", "m;s", "(" * 5000, "m" * 5000, "m**99999", "nan", "lambda: 1", "m.", ".", "m2.3",
]  # fmt: skip


@pytest.mark.parametrize("unit", ODD)
def test_what_is_no_unit_is_refused(unit: str) -> None:
    with pytest.raises(UsageError, match=r"unit|range"):
        factor(unit, "1")


@pytest.mark.parametrize(
    ("unit", "si"), [("degC", "K"), ("degF", "K"), ("dB", "1"), ("dBm", "kg.m2/s3"), ("Np", "1")]
)
def test_units_that_are_no_plain_multiple_are_refused(unit: str, si: str) -> None:
    assert factor(unit, unit) == 1.0
    for call in (
        lambda: factor(unit, si),
        lambda: base_exponents(unit),
        lambda: parse_quantity(f"3 {unit}", si),
    ):
        with pytest.raises(UsageError, match="offset or is logarithmic"):
            call()


def test_differences_of_temperature_are_plain_multiples() -> None:
    assert factor("delta_degC", "K") == 1.0


@pytest.mark.parametrize(
    ("unit", "target", "value"),
    [
        ("bar", "Pa", 1e5),
        ("bar/mm", "Pa/m", 1e8),
        ("kg.mm2", "kg.m2", 1e-6),
        ("kg*m**2", "kg.m2", 1.0),
        ("N.m.s/deg", "N.m.s/rad", 180 / math.pi),
        ("m/(s.s)", "m.s-2", 1.0),
        ("\N{DEGREE SIGN}/s", "rad/s", math.pi / 180),
        ("%", "1", 0.01),
        ("1/%", "1", 100.0),
        ("rev", "rad", 2 * math.pi),
        ("rev/min", "rad/s", math.pi / 30),
        ("rpm", "rad/s", math.pi / 30),
        ("l/min", "m3/s", 1e-3 / 60),
        ("", "1", 1.0),
    ],
)
def test_factors(unit: str, target: str, value: float) -> None:
    assert factor(unit, target) == pytest.approx(value, rel=1e-14)
    assert factor(target, unit) == pytest.approx(1.0 / value, rel=1e-14)


@pytest.mark.parametrize(
    ("unit", "target", "value"),
    [
        ("Grad", "rad", math.pi / 180),
        ("Grad/s", "deg/s", 1.0),
        ("Nm", "N.m", 1.0),
        ("kNm", "N.m", 1e3),
        ("U/min", "rad/s", math.pi / 30),
    ],
)
def test_german_spellings_are_what_their_writer_meant(unit: str, target: str, value: float) -> None:
    """Pint alone reads a gigaradian, a number of metres and an enzyme's activity."""
    assert factor(unit, target) == pytest.approx(value)


def test_wrong_dimension_names_both() -> None:
    with pytest.raises(UsageError, match=r"'bar' has the wrong dimension: expected one like 'kg\.m2'"):
        factor("bar", "kg.m2")


@pytest.mark.parametrize(
    ("unit", "exponents", "scale"),
    [
        ("N.m.s/rad", {"kg": 1, "m": 2, "s": -1, "rad": -1}, 1.0),
        ("bar", {"kg": 1, "m": -1, "s": -2}, 1e5),
        ("rpm", {"rad": 1, "s": -1}, math.pi / 30),
        ("rev", {"rad": 1}, 2 * math.pi),
        ("%", {}, 0.01),
        ("V", {"kg": 1, "m": 2, "s": -3, "A": -1}, 1.0),
    ],
)
def test_base_exponents(unit: str, exponents: dict[str, int], scale: float) -> None:
    found, factor_found = base_exponents(unit)
    assert found == exponents
    assert factor_found == pytest.approx(scale, rel=1e-14)


def test_units_outside_fmi_s_base_units_are_refused() -> None:
    with pytest.raises(UsageError, match="bit"):
        base_exponents("byte")


def test_quantities() -> None:
    assert parse_quantity("900 kg.m2", "kg.m2") == 900.0
    assert parse_quantity("-2.5e1mm", "m") == -0.025
    assert parse_quantity(" .5 ", "s") == 0.5
    for text in ("", "m", "1 2 m", "0x1 m", "1e400 m", "nan"):
        with pytest.raises(UsageError):
            parse_quantity(text, "m")


PIECES = st.sampled_from(
    ["m", "s", "kg", "rad", "deg", "%", "dB", "degC", "e", "1", "2", "-3", "99", "0", "1e9", ".", "*", "**", "^", "/", "(",
     ")", " ", "-", "+", ",", "[", "'", "\n", "\N{SUPERSCRIPT TWO}", "\N{MICRO SIGN}", "\N{GREEK CAPITAL LETTER DELTA}", "_",
     "#", "\x00"]
)  # fmt: skip
TEXTS = st.one_of(st.lists(PIECES, max_size=12).map("".join), st.text(max_size=20))


@settings(max_examples=400)
@given(TEXTS)
@example("9**9**9")
def test_any_text_gives_a_unit_or_a_usage_error(text: str) -> None:
    try:
        unit = parse_unit(text)
        exponents, scale = base_exponents(text)
    except UsageError:
        return
    assert scale > 0.0
    assert all(isinstance(power, int) for power in exponents.values())
    assert factor(text, text) == pytest.approx(1.0, rel=1e-12)
    assert unit == parse_unit(fmi_to_pint(text)), "pint's spelling is read as well"


@given(st.floats(allow_nan=False, allow_infinity=False), st.sampled_from(["m", "bar", "deg/s", "kg.m2", "%"]))
def test_a_number_in_its_own_unit_stays_itself(value: float, unit: str) -> None:
    assert parse_quantity(f"{value!r} {unit}", unit) == value


@pytest.mark.parametrize("damage", ["none", "cut short", "a file in its place"])
def test_units_are_read_whatever_the_cache_is_like(tmp_path, monkeypatch, damage: str) -> None:
    monkeypatch.setenv("COSIM_CACHE", str(tmp_path))
    folder = tmp_path / "units"
    if damage == "a file in its place":
        folder.write_text("no folder", encoding="utf-8")
    else:
        registry.__wrapped__()
        kept = list(folder.glob("*.pickle"))
        assert kept
        for file in kept if damage == "cut short" else ():
            file.write_bytes(file.read_bytes()[:100])
    made = registry.__wrapped__()
    assert made.Quantity(180.0, "deg").to("rad").magnitude == pytest.approx(math.pi)
    assert made.Quantity(50.0, "percent").to_base_units().magnitude == pytest.approx(0.5)


def test_units_kept_by_an_environment_that_is_gone_are_read_and_kept_anew(tmp_path, monkeypatch) -> None:
    """The cache says where pint lay; once that is gone every command read the definitions again."""
    import pint

    monkeypatch.setenv("COSIM_CACHE", str(tmp_path / "cache"))
    gone = tmp_path / "gone"
    shutil.copytree(Path(pint.__file__).parent, gone / "pint")
    fill = "from cosim.units import registry; registry()"
    variables = {**os.environ, "PYTHONPATH": os.pathsep.join([str(gone), *sys.path])}
    subprocess.run([sys.executable, "-c", fill], env=variables, check=True)
    shutil.rmtree(gone)
    kept = tmp_path / "cache" / "units"
    before = {file.name for file in kept.glob("*.pickle")}
    assert before
    assert registry.__wrapped__().Quantity(180.0, "deg").to("rad").magnitude == pytest.approx(math.pi)
    # one that fails with what is kept reads no further than this
    assert pint.UnitRegistry(cache_folder=kept).Quantity(1.0, "m").magnitude == 1.0


@pytest.mark.parametrize(
    ("log", "fmu", "number"),
    [("degC", "degC", 20.0), ("degC", "K", 293.15), ("degF", "degC", -6.6667), ("K", "degC", -253.15)],
)
def test_temperatures_keep_their_zero_between_log_and_fmu(log, fmu, number):
    """A log in degC was refused beside every FMU, also by the mapping that `cosim init` had written of it."""
    factor, offset = of_reading(log, log, fmu, {})
    assert factor * 20.0 + offset == pytest.approx(number, abs=1e-4)


def test_a_mapping_may_have_a_column_in_degrees_celsius(tmp_path):
    """Its readings are taken as they are: what an FMU makes of them is asked when both are known."""
    log, mapping = tmp_path / "heat.csv", tmp_path / "heat.toml"
    log.write_text("time [s],temp [degC]\n" + "".join(f"{k},{20 + k}\n" for k in range(20)))
    mapping.write_text(
        'model = "heat.fmu"\n[time]\ncolumn = "time [s]"\n[signals.temp]\ncolumn = "temp [degC]"\nunit = "degC"\n'
    )
    read = load_log(log, load_mapping(mapping)[0])
    assert read.units["temp"] == read.display["temp"] == "degC"
    assert read.signals["temp"][3] == 23.0
