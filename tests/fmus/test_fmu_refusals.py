"""Bad use of an FMU is refused with a message that names the variable, its value and the limit, and the host lives on.

All cases run in one other process per FMU, so a crash shows as its exit code.
"""

import json
import subprocess
import sys
from pathlib import Path

import pytest
from fmpy import extract
from fmu_raw import DISCARD, OK, Instance
from fmu_scenarios import BAD_USE

from fmus.build import build_fmu, composed_block

HERE = Path(__file__).resolve().parent

# what the message must say, for mechanical.fmu
SAYS = {
    "nan": ["p_load = nan", "-1000000000.0 to 1000000000.0", "0.0 is kept"],
    "infinite": ["p_load = inf", "1000000000.0"],
    "minus_infinite": ["p_load = -inf"],
    "out_of_range": ["p_load = 100000000000.0", "-1000000000.0 to 1000000000.0"],
    "zero_step": ["step size 0.0 s", "positive"],
    "negative_step": ["step size -0.001 s"],
    "nan_step": ["step size nan s"],
    "infinite_step": ["step size inf s"],
    "parameter_after_initialisation": ["parameter J is fixed", "1.0", "reset first"],
    "output_set": ["theta is an output"],
    "unknown_reference_set": ["no variable with value reference 999"],
    "unknown_reference_read": ["no variable with value reference 999"],
    "real_set_as_integer": ["p_load is a Real"],
    "real_read_as_integer": ["p_load is a Real"],
    "boolean_set": ["no Boolean"],
    "boolean_read": ["no Boolean"],
    "string_set": ["no String"],
    "string_read": ["no String"],
    "early_out_of_range": ["J = 100000000000.0", "1e-12 to 1000000000.0"],
    "early_nan": ["J = nan", "763.9437268410978 is kept"],
    "early_step": ["before initialisation is complete"],
    "early_exit": ["fmi2ExitInitializationMode without"],
    "early_bad_start_time": ["start time nan s"],
    "enter_again": ["fmi2EnterInitializationMode while running"],
    "exit_again": ["fmi2ExitInitializationMode without"],
    "setup_again": ["fmi2SetupExperiment after"],
    "step_after_end": ["fmi2DoStep after fmi2Terminate"],
    "state_garbage": ["state cannot be restored", "not saved by mechanical_"],
    "state_empty": ["state cannot be restored"],
    "state_deep": ["state cannot be restored"],
    "state_of_another_type": ["state cannot be restored"],
    "state_of_another_model": ["not saved by mechanical_"],
    "state_short": ["does not fit"],
    "state_without_values": ["values"],
    "state_nan": ["no numbers"],
    "state_text": ["state cannot be restored"],
    "state_mode": ["does not fit"],
    "state_step": ["no numbers"],
}
ANSWERS_DISCARD = {"zero_step", "negative_step", "nan_step", "infinite_step", "early_step", "step_after_end"}


@pytest.fixture(scope="module")
def reports(unpacked) -> dict[str, dict[str, dict]]:
    """What every bad use did to three different FMUs."""
    found = {}
    for name in ("mechanical", "dead_zone", "stimulus"):
        command = [sys.executable, str(HERE / "fmu_scenarios.py"), "refuse", str(unpacked[name])]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        assert done.returncode == 0, f"{name}: exit code {done.returncode}\n{done.stdout}\n{done.stderr}"
        found[name] = json.loads(done.stdout)
    return found


def test_every_bad_use_is_described() -> None:
    assert set(SAYS) == set(BAD_USE)


@pytest.mark.parametrize("use", SAYS)
def test_the_message_names_variable_value_and_limit(reports, use) -> None:
    messages = reports["mechanical"][use]["messages"]
    assert len(messages) == 1, "once, not at every call"
    for text in SAYS[use]:
        assert text in messages[0]
    assert messages[0].startswith(f"{use}: "), "the instance's name comes first"


@pytest.mark.parametrize("block", ["mechanical", "dead_zone", "stimulus"])
@pytest.mark.parametrize("use", SAYS)
def test_refused_then_discarded_then_reset(reports, block, use) -> None:
    """The call itself cannot fail under pythonfmu; the next step is discarded, never fatal; a reset makes all well."""
    if use not in reports[block]:
        pytest.skip(f"{block} has no input")
    report = reports[block][use]
    assert report["messages"], "refused in words"
    assert report["status"] == (DISCARD if use in ANSWERS_DISCARD else OK)
    assert report["next"] == [DISCARD, DISCARD]
    if not use.startswith("early"):
        assert report["kept"], "the last good values stay readable"
    assert report["after_reset"] == OK


def test_integers_have_calls_of_their_own(unpacked) -> None:
    slave = Instance(unpacked["dead_zone"])
    form = [slave.vr["form"]]
    slave.fmu.setInteger(form, [3])
    assert slave.fmu.getInteger(form) == [3]
    slave.initialise()
    assert not slave.messages
    assert slave.play([[1.0]]) == [[1.0]], "form 3 gives 1.45, limited"
    for call, value, text in (
        (slave.fmu.setReal, 2.0, "is an Integer"),
        (slave.fmu.setInteger, 7, "from 1.0 to 3.0"),
    ):
        slave.fmu.reset()
        slave.messages.clear()
        call(form, [value])
        assert text in slave.messages[0]
        assert "form" in slave.messages[0]
        assert slave.fmu.getInteger(form) == [1]
    slave.close()


def test_a_table_that_cannot_be_read_is_refused(tmp_path) -> None:
    """The stimulus cannot begin; it says so and steps are discarded."""
    for k, table in enumerate((b"", b"time,u\n", b"time,u\n0,one\n")):
        fmu = build_fmu(composed_block("stimulus"), tmp_path / f"{k}.fmu", resources={"stimulus.csv": table})
        slave = Instance(Path(extract(str(fmu), str(tmp_path / str(k)))))
        slave.initialise()
        assert any("stimulus.csv" in m for m in slave.messages), slave.messages
        assert slave.step(0.0) == DISCARD
        slave.close()
