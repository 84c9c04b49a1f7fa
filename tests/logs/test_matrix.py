"""Tables that stand in brackets, as MATLAB writes a matrix."""

import pytest

from cosim.logs.matrix import holds_matrix, table
from cosim.logs.overview import overview

SCRIPT = """\
% step response of the plant, 3 March
clear all; close all;
gains = [1.0, 2.0; 3.0, 4.0];
% time  u  angle
data = [ % by the card
{rows}
];
figure; plot(data(:, 1), data(:, 3));
"""


@pytest.mark.parametrize("begin", ["[", "data =["])
@pytest.mark.parametrize("mark", ["", "%"])
def test_a_matrix_as_matlab_writes_it_is_a_table(write, begin, mark):
    """Laboratory plants log so: names of several words, a blank line, and the rows of a matrix."""
    lines = [f"{k:6d}  {0.022 * k:8.3f}  {20 * k:10d}  {-0.5 + 0.01 * k:10.4f};" for k in range(40)]
    text = "\n".join([f"{begin}{lines[0]}", *lines[1:-1], lines[-1].replace(";", "]")])
    found = overview(
        write(f"{mark} Sample   Time     Encoder 1 Pos   Control Effort\n\n{text}\n", "plant.txt")
    )
    assert [c.label.text for c in found.columns] == ["Sample", "Time", "Encoder 1 Pos", "Control Effort"]
    assert [float(c.values[-1]) for c in found.columns] == pytest.approx([39.0, 0.858, 780.0, -0.11])
    assert all(c.values.size == 40 for c in found.columns)


@pytest.mark.parametrize("sign", [" ", "\t", ", ", ",\t"])
@pytest.mark.parametrize("end", [";", "", " ; % sample"])
def test_the_matrix_of_a_script_is_its_log(write, sign, end):
    rows = "\n".join(sign.join((f"{0.01 * k:.2f}", f"{k % 2}", f"{-0.5 * k:g}")) + end for k in range(50))
    found = overview(write(SCRIPT.format(rows=rows), "plant.m"))
    assert [c.label.text for c in found.columns] == ["time", "u", "angle"]
    assert found.columns[2].values.tolist() == [-0.5 * k for k in range(50)]


def test_rows_stay_in_their_lines_and_may_share_one():
    made = table(SCRIPT.format(rows="0 1 2\n1 NaN 3 % lost\n\n2 1 4").encode()).decode().split("\n")
    assert made[:9] == [
        "% step response of the plant, 3 March", "", "", "% time  u  angle", "", "0  1  2", "1  NaN  3", "", "2  1  4",
    ]  # fmt: skip
    assert table(b"x = [0 1; 1 2; 2 3;\n3 4]\n").split(b"\n") == [b"0  1", b"1  2", b"2  3", b"3  4", b""]


@pytest.mark.parametrize(
    "text",
    [
        "[0.01] started\n[0.02] speed 3\n",
        "time [s],slew [deg]\n0,1\n1,2\n",
        "[section]\nkey = [1, 2]\n0 1\n",
        "[\n[0, 1],\n[1, 2]\n]\n",
        "x = [\n0 1\n1 2\n",
    ],
    ids=["stamps", "units", "settings", "nested", "not closed"],
)
def test_other_brackets_are_no_matrix(write, text):
    assert not holds_matrix(write(text, "log.txt"))
