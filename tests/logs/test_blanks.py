"""Tables parted by blanks, numbers with a prefix, clocks without a name: as programs and instruments write them."""

import numpy as np
import pytest
from log_files import HEADER, rows

from cosim.errors import DataError, HeadlessError
from cosim.logs import load_log, load_mapping
from cosim.logs.overview import overview, unit_within
from cosim.logs.text import TextSource


def aligned(text: str) -> str:
    """The same table in columns of one width, as FORTRAN and ``numpy.savetxt`` write it."""
    return "".join("  ".join(cell.rjust(12) for cell in line.split(",")) + "\n" for line in text.splitlines())


@pytest.mark.parametrize("mark", ["", "# ", "% "])
def test_a_table_parted_by_blanks_is_the_same_log(load, write, mark):
    plain = load(rows())
    log = load_log(write(mark + aligned(HEADER + "\n".join(rows()) + "\n").lstrip(), "aligned.dat"))
    assert log.warnings == ()
    np.testing.assert_array_equal(log.time, plain.time)
    np.testing.assert_array_equal(log["slew"], plain["slew"])


def test_a_table_parted_by_bars_is_the_same_log(load, write):
    """As loggers write it that show the table as well: numbers padded with blanks, and a bar at the end of each line."""
    plain = load(rows())
    barred = "".join(line.replace(",", "  |") + "|\n" for line in [HEADER.strip(), *rows()])
    log = load_log(write(barred, "barred.txt"))
    np.testing.assert_array_equal(log.time, plain.time)
    np.testing.assert_array_equal(log["slew"], plain["slew"])


def test_without_names_a_table_parted_by_bars_goes_by_the_place_of_its_columns(write):
    text = "".join(f"{0.01 * k:g}|{k % 5}.   |{0.5 * k:g}|\n" for k in range(60))
    found = overview(write(text, "barred.txt"))
    assert not found.header
    assert found.columns[1].label.text == "2"
    np.testing.assert_allclose(found.columns[2].values, 0.5 * np.arange(60))


def test_a_first_row_of_numbers_beside_a_remark_names_no_columns(write):
    """A log of 42 columns without names ended in a place, `0 0 0.07`: its first row was taken for their names."""
    text = "".join(f"{0.04 * k:.2f};{k * k};{3 * k};{k} 0 0.07\n" for k in range(60))
    found = overview(write(text, "place.txt"))
    assert not found.header
    assert [c.label.text for c in found.columns] == ["1", "2", "3", "4"]


@pytest.mark.parametrize("header", ["time;0;1;2", ";1;2;3", "t;2020;2021;note"])
def test_a_row_of_names_may_hold_numbers(write, header):
    cells = header.count("note")
    text = header + "\n" + "".join(f"{k};{2 * k};{k + 1};{'ok' if cells else k}\n" for k in range(60))
    assert overview(write(text, "named.csv")).header


def test_a_bad_cell_between_blanks_is_named_with_its_row(write):
    text = aligned(HEADER + "\n".join(rows()) + "\n").replace(f"{0.5 * 7:g}\n", "x7\n")
    with pytest.raises(DataError, match=r"row 9, column 'slew \[deg\]': 'x7' is not a number"):
        load_log(write(text, "aligned.dat"))


def test_a_title_above_such_a_table_is_left_out(write, load):
    log = load_log(write("run 3 of 12\n" + aligned(HEADER + "\n".join(rows()) + "\n"), "titled.dat"))
    np.testing.assert_array_equal(log["slew"], load(rows())["slew"])


def test_one_column_with_a_blank_in_its_name_stays_one(write):
    found = overview(write("valve command\n" + "\n".join(str(k / 7) for k in range(30)) + "\n", "one.csv"))
    assert [c.label.text for c in found.columns] == ["valve command"]


def test_a_decimal_comma_between_blanks(write):
    text = "t  x\n" + "".join(f"{k},5   {k},25\n" for k in range(30))
    source = TextSource(write(text, "comma.dat"))
    np.testing.assert_allclose(source.read([1])[0], np.arange(30) + 0.25)


def test_without_names_the_columns_go_by_their_place_and_time_is_found_in_spite_of_gaps(write):
    """Stamps of a small computer: nearly always 2 ms, now and then late."""
    rng = np.random.default_rng(3)
    steps = 0.002 + 1e-6 * rng.integers(0, 5, 600)
    steps[[50, 333]] += 0.02
    t = np.cumsum(steps)
    text = "".join(f"{s:.6f} {np.sin(3.0 * s):.6f} {k % 9}\n" for k, s in enumerate(t))
    path = write(text, "plain.dat")
    with pytest.raises(HeadlessError):
        TextSource(path)
    found = overview(path)
    assert not found.header
    assert [c.label.text for c in found.columns] == ["1", "2", "3"]
    assert found.clock is not None
    assert (found.clock.column, found.clock.unit) == (0, "s")


@pytest.mark.parametrize(
    ("stamps", "unit"),
    [
        (0.656 * np.arange(50), "s"),  # telemetry, 1.5 a second
        (np.arange(50.0), "ms"),  # a counter
        (20.0 * np.arange(50), "ms"),
        (0.01 * np.arange(50), "s"),
        (1e5 * np.arange(50), "us"),
    ],
)
def test_an_unlabelled_clock_counts_in_the_unit_of_a_likely_log(write, stamps, unit):
    text = "timestamp,x\n" + "".join(f"{s:.9g},{np.sin(k):.6f}\n" for k, s in enumerate(stamps))
    found = overview(write(text, "clock.csv"))
    assert found.clock is not None
    assert found.clock.unit == unit


def test_a_rising_column_of_few_values_or_of_tiny_steps_is_no_clock(write):
    """The axes' limits that LabVIEW writes beside a graph, and the abscissa of a curve."""
    text = "limit;range;x\n" + "".join(
        f"{(-30, 30)[k] if k < 2 else ''};{-0.025 + 5e-6 * k:.7f};{k % 7}\n" for k in range(300)
    )
    assert overview(write(text, "graph.csv")).clock is None


def test_numbers_with_a_prefix_are_read_as_such_and_told(write):
    """As LabVIEW exports its graphs."""
    text = "Current (mA) - Plot 0\tPressure (psi) - Plot 0\n" + "".join(
        f"{k - 15}.5m\t{'-1.5k' if k % 2 else '2.2'}\n" for k in range(30)
    )
    found = overview(write(text, "graph.txt"))
    current, pressure = found.columns
    np.testing.assert_allclose(
        current.values, 1e-3 * (np.arange(30) - 15 + np.where(np.arange(30) < 15, -0.5, 0.5))
    )
    assert set(pressure.values) == {-1500.0, 2.2}
    assert (current.unit, pressure.unit) == ("mA", "psi")
    assert [w for w in found.warnings if "prefix" in w]


@pytest.mark.parametrize("cell", ["5 mm", "m", "1.2.3k", "k5"])
def test_what_only_looks_like_a_prefix_is_refused(write, cell):
    with pytest.raises(DataError, match="is not a number"):
        load_log(write(HEADER + "\n".join([*rows(), f"0.03,{cell},1"]) + "\n"))


@pytest.mark.parametrize(
    ("name", "unit"),
    [
        ("rod_mm", "mm"),
        ("motor_speed_rpm", "rpm"),
        ("time_ms", "ms"),
        ("flow (l/min) - plot 0", "l/min"),
        ("supply_current_A", "A"),
        ("pressure_A", None),  # the port
        ("p_s", None),  # of the supply
        ("x_m", None),
        ("cylinder_position_m", "m"),
        ("boom_speed_deg_per_sec", "deg/s"),
        ("rod_mm_s", "mm/s"),
        ("shaft_rev_per_min", "turn/min"),
        ("data(:,2)", None),
        ("mm", None),
    ],
)
def test_a_unit_within_a_name(name, unit):
    assert unit_within(name) == unit


def test_a_prefix_beside_a_unit_that_has_it_and_digits_that_change_with_it_are_told(write):
    """A servo valve's `25.1m` under `(mA)`, and flows of 0.7315 and 2.5: "unexplained" for steps that the file made."""
    flow = [f"{1000 * q:.1f}m" if abs(q) < 1.0 else f"{q:.1f}" for q in np.linspace(-2.5, 2.5, 101)]
    rows_ = "".join(f"{k - 50}.5m\t{q}\n" for k, q in enumerate(flow))
    found = overview(write("Current (mA) - Plot 0\tFlow (GPM) - Plot 0\n" + rows_, "graph.txt"))
    twice, digits = (next(w for w in found.warnings if t in w) for t in ("was read as", "few digits"))
    assert "'-50.5m' was read as -0.0505 mA; if it means -50.5 mA, write unit = \"A\"" in twice
    assert "Flow (GPM) - Plot 0" in digits
    said = '[time]\nstep = 0.01\n[signals]\ncurrent = { column = "Current (mA) - Plot 0", unit = "A" }\n'
    read = load_log(found.path, load_mapping(write(said, "said.toml")))
    assert read["current"][0] == pytest.approx(-0.0505)
    assert not any("was read as" in w for w in read.warnings)
    assert "rounded to 0.0001 where it is small and to 0.1 where it is large" in digits


def test_the_digits_of_one_prefix_are_not_told(write):
    text = "Flow (min) - Plot 0\tx\n" + "".join(f"{k}.5m\t{k}\n" for k in range(30))
    assert len(overview(write(text, "graph.txt")).warnings) == 1
