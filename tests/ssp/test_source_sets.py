"""The parameter sets that the source prints: each value is the printed one, and a name is enough to use it."""

import math
from pathlib import Path

import pytest

from cosim.errors import ModelError, UsageError
from cosim.request import parameters, set_file, source_sets
from cosim.ssp import read_ssv, read_system

DEGREE = math.pi / 180.0
# the source's tables as printed, in the units of the wires
PRINTED = {
    "table_4_1": {
        "compensator.d_plus": 0.45,
        "compensator.d_minus": 0.40,
        "dead_zone.b_r": 0.45,
        "dead_zone.b_l": -0.40,
    },
    "table_4_2_tf1": {"simplified.k": 10.0 * DEGREE, "simplified.a": 4.4},
    "table_4_3_tf1": {"dcv.K": 2.3048e-3, "dcv.w0": 23.19, "dcv.zeta": 0.55},
    "table_4_3_tf2": {"dcv.K": 2.3432e-3, "dcv.w0": 25.60, "dcv.zeta": 0.52},
    "table_4_3_tf3": {"dcv.K": 2.4678e-3, "dcv.w0": 27.64, "dcv.zeta": 0.55},
    "table_4_3_tf4": {"dcv.K": 2.3747e-3, "dcv.w0": 25.23, "dcv.zeta": 0.54},
    "table_4_4_tf1": {"continuity.K_c": 4.638e8, "continuity.T": 0.07},
    "table_4_4_tf2": {"continuity.K_c": 5.709e8, "continuity.T": 0.10},
    "table_4_4_tf3": {"continuity.K_c": 5.709e8, "continuity.T": 0.18},
    "table_4_4_tf4": {"continuity.K_c": 5.28e8, "continuity.T": 0.11},
    "spool_limit_2_35": {"dcv.x_min": -2.35e-3, "dcv.x_max": 2.35e-3},
}


def test_every_set_holds_the_printed_values():
    assert source_sets().keys() == PRINTED.keys()
    for name, values in PRINTED.items():
        found = {v.name: float(v.value) for v in read_ssv(set_file(Path(name)))}
        assert found == pytest.approx(values, rel=1e-12), name


def test_a_file_stays_a_file_and_an_unknown_name_is_answered(tmp_path):
    file = tmp_path / "own.ssv"
    assert set_file(file) == file
    assert set_file(Path("folder/table_4_1")) == Path("folder/table_4_1")
    with pytest.raises(UsageError, match=r"one of the source.s: .*table_4_3_tf4"):
        set_file(Path("table_4_3_tf5"))


def test_a_set_for_another_model_says_so(packages):
    with (
        read_system(packages["full_order"]) as system,
        pytest.raises(
            ModelError, match=r"no 'simplified\.k': the set is for another model, this one has comp"
        ),
    ):
        parameters(system, [Path("table_4_2_tf1")], [])
