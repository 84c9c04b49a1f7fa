"""What the answer says of the command's levels."""

import numpy as np
import pytest
from hidden_logs import only

from cosim.diagnosis.answer.remarks import levels, limits, one_sided, one_way
from cosim.diagnosis.model.machine import our_machine
from cosim.diagnosis.pipeline.diagnose import diagnose, prepare
from cosim.rig import as_log, make_log


def test_levels_that_a_command_holds() -> None:
    step = np.repeat([0.0, 0.5, 0.0], [100, 800, 100])
    assert levels(step) == pytest.approx([0.5])
    assert levels(np.concatenate([step, -0.9 * step])) == pytest.approx([-0.45, 0.5])
    ramp = np.linspace(0.0, 0.5, 12)
    assert levels(np.concatenate([np.zeros(100), ramp, np.full(900, 0.5)])) == pytest.approx([0.5])
    assert levels(np.sin(np.linspace(0.0, 20.0, 2000))).size > 50
    assert levels(np.zeros(10)).size == 0


@pytest.mark.parametrize(
    ("duties", "said"), [((0.5,), True), pytest.param((0.5, 0.9), False, marks=pytest.mark.slow)]
)
def test_one_level_tells_no_dead_zone(duties: tuple[float, ...], said: bool) -> None:
    log = as_log(make_log("steps", 12.0, [], seed=3))
    u = np.zeros(len(log))
    for duty, part in zip(duties, np.array_split(np.arange(1000, u.size), len(duties)), strict=True):
        u[part] = duty
    found = diagnose(log, model=only("dcv"))
    found.record.signals["u"] = u
    assert any("one level on a side only (0.5)" in text for text in limits(found, (log,))) == said


@pytest.mark.parametrize("hidden", [(), ("mechanical.gravity_load",), ("dcv.offset",)])
def test_the_missing_column_of_the_other_direction_is_asked_for(hidden: tuple[str, ...]) -> None:
    machine = our_machine("full_order")
    log = as_log(make_log("steps", 20.0, list(hidden), seed=4))
    record = prepare(log, machine)
    assert not one_way(record, machine)
    upwards = np.repeat([0.0, 0.4, 0.0, 0.6], 3000)
    assert not one_way(prepare(as_log(make_log(upwards, 12.0, list(hidden), seed=4)), machine), machine)
    record.signals["u"] = np.maximum(record.signals["u"], 0.0)
    (text,) = one_way(record, machine)
    assert "while u is 0" in text
    assert "`minus`" in text


def test_logs_of_one_direction_are_told() -> None:
    machine = our_machine("full_order")
    for way, never in ((1.0, "negative"), (-1.0, "positive")):
        command = way * np.repeat([0.0, 0.4, 0.0, 0.6], 3000)
        (text,) = one_sided(prepare(as_log(make_log(command, 12.0, [], seed=4)), machine), machine)
        assert f"u is never {never}" in text
    both = np.repeat([0.0, 0.4, 0.0, -0.6], 3000)
    assert not one_sided(prepare(as_log(make_log(both, 12.0, [], seed=4)), machine), machine)
    standing = prepare(as_log(make_log(np.zeros(12000), 12.0, [], seed=4)), machine)
    assert not one_sided(standing, machine)
