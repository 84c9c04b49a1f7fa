"""Bad use of a native FMU is refused with fmi2Error and the words of the Python twin, and the instance lives on."""

import struct

import pytest
from fmpy import extract
from fmpy.fmi2 import FMU2Slave, fmi2CallbackFunctions, fmi2CallbackLoggerTYPE
from fmu_raw import ERROR, OK, Instance
from fmu_scenarios import BAD_USE, NEED_AN_INPUT
from hypothesis import given, settings
from hypothesis import strategies as st
from test_fmu_refusals import SAYS

from cosim.native.build import build_native
from fmus.build import composed_block

# states of the twin are JSON; here they are damaged byte by byte
USES = {
    n: use for n, use in BAD_USE.items() if not n.startswith("state") or n in ("state_garbage", "state_empty")
}
MODE, STEP, VALUES = 72, 96, 104  # places in a saved state: after magic and GUID, four numbers, the time


def damaged(place: int, data: bytes):
    """Restore a state with some bytes changed."""

    def use(s: Instance) -> int:
        state = bytearray(s.state_bytes())
        state[place : place + len(data)] = data
        return s.status(s.restore_bytes, bytes(state))

    return use


KEPT: dict[str, Instance] = {}
NAN, ZERO = struct.pack("d", float("nan")), struct.pack("d", 0.0)
STATES = {
    "state_of_another_model": (damaged(8, b"{00000000"), "it was not saved by mechanical {"),
    "state_of_another_order_of_bytes": (damaged(0, bytes(8)), "on a platform like this"),
    "state_mode": (damaged(MODE, struct.pack("i", 7)), "it does not fit"),
    "state_step": (damaged(STEP, ZERO), "no numbers"),
    "state_nan": (damaged(VALUES, NAN), "no numbers"),
    "state_short": (lambda s: s.status(s.restore_bytes, s.state_bytes()[:-8]), "bytes, not"),
}
WORDS = {n: SAYS[n] for n in USES} | {
    n: ["state cannot be restored", text] for n, (_, text) in STATES.items()
}
WORDS |= {"state_garbage": ["not saved by mechanical {"], "state_empty": ["it has 0 bytes"]}
ALL = USES | {n: use for n, (use, _) in STATES.items()}


@pytest.mark.parametrize("block", ["mechanical", "dead_zone", "stimulus"])
@pytest.mark.parametrize("use", ALL)
def test_refused_then_no_step_then_reset(unpacked, block, use) -> None:
    """Refused at once, in words; steps are refused from then on; the last good values stay; a reset makes all well."""
    slave = Instance(unpacked[block], use, logging=False)  # errors are told whether or not debugging is on
    if ALL[use] in NEED_AN_INPUT and not slave.inputs:
        pytest.skip(f"{block} has no input")
    if not use.startswith("early"):
        slave.initialise()
        assert slave.step(0.0) == OK
    before = slave.get(*slave.outputs)
    assert ALL[use](slave) == ERROR
    assert len(slave.messages) == 1, "once, not at every call"
    assert slave.messages[0].startswith(f"{use}: "), "the instance's name comes first"
    if block == "mechanical":
        for text in WORDS[use]:
            assert text in slave.messages[0]
    assert [slave.step(0.01), slave.step(0.011)] == [ERROR, ERROR]
    if not use.startswith("early"):
        assert slave.get(*slave.outputs) == before
    slave.fmu.reset()
    assert slave.initialise().step(0.0) == OK
    slave.close()


@pytest.mark.parametrize(
    ("variable", "value"), [("form", 6.8e38), ("form", 4.0), ("m_r", -1.0), ("command", 1e6)]
)
def test_a_state_with_what_no_setter_takes_is_refused(unpacked, variable, value) -> None:
    """An Integer of 6.8e38 would be undefined behaviour where it is read."""
    slave = Instance(unpacked["dead_zone"], "bounds", logging=False)
    slave.initialise()
    restore = damaged(VALUES + 8 * slave.vr[variable], struct.pack("d", value))
    assert restore(slave) == ERROR
    assert "it holds values beyond their bounds" in slave.messages[0]
    slave.close()


def test_integers_have_calls_of_their_own(unpacked) -> None:
    slave = Instance(unpacked["dead_zone"])
    form = [slave.vr["form"]]
    slave.fmu.setInteger(form, [3])
    assert slave.fmu.getInteger(form) == [3]
    slave.initialise()
    assert slave.play([[1.0]]) == [[1.0]], "form 3 gives 1.45, limited"
    for call, value, text in (
        (slave.fmu.setReal, 2.0, "is an Integer"),
        (slave.fmu.setInteger, 7, "from 1.0 to 3.0"),
    ):
        slave.fmu.reset()
        slave.messages.clear()
        assert slave.status(call, form, [value]) == ERROR
        assert text in slave.messages[0]
        assert "form" in slave.messages[0]
        assert slave.fmu.getInteger(form) == [1]
    slave.close()


@pytest.mark.parametrize(
    ("table", "text"),
    [
        (b"", "stimulus.csv cannot be read: it has no rows below its header"),
        (b"time,u\n", "it has no rows below its header"),
        (b"time,u\n0,one\n", "row 2, column 2: 'one' is no number"),
        (b"time,u\r\n0,1\r\n0.1\r\n", "row 3, column 2"),
        (b"time,u\n0,0x10\n", "'0x10' is no number"),
        (b"time,u\n0,1e999\n", "'1e999' is no number"),
        (None, "there is no such file"),
    ],
)
def test_a_table_that_cannot_be_read_is_refused(tmp_path, table, text) -> None:
    resources = {"stimulus.csv": table} if table is not None else {}
    fmu = build_native(composed_block("stimulus"), tmp_path / "s.fmu", resources=resources)
    slave = Instance(extract(str(fmu), str(tmp_path / "unpacked")))
    slave.fmu.setupExperiment(startTime=0.0)
    assert slave.status(slave.fmu.enterInitializationMode) == ERROR
    assert text in slave.messages[0]
    assert slave.status(slave.fmu.exitInitializationMode) == ERROR
    assert slave.step(0.0) == ERROR
    slave.close()


def test_tables_with_blanks_and_line_ends_of_windows(tmp_path) -> None:
    table = b"time [s],u [1]\r\n 0 , 0.5\r\n1e-2,-2.5E-1,comment\r\n"
    fmu = build_native(composed_block("stimulus"), tmp_path / "s.fmu", resources={"stimulus.csv": table})
    slave = Instance(extract(str(fmu), str(tmp_path / "unpacked"))).initialise()
    assert slave.get("u") == [0.5]
    assert slave.play([[]] * 11)[-1] == [-0.25]
    slave.close()


@pytest.mark.parametrize("guid", ["{wrong}", ""])
def test_a_wrong_guid_and_model_exchange_are_refused(unpacked, guid) -> None:
    said: list[str] = []
    callbacks = fmi2CallbackFunctions()
    callbacks.logger = fmi2CallbackLoggerTYPE(
        lambda e, name, status, category, text: said.append(text.decode())
    )
    slave = FMU2Slave(
        guid=guid, unzipDirectory=str(unpacked["dcv"]), modelIdentifier="dcv", instanceName="valve"
    )
    with pytest.raises(Exception, match="instantiate"):
        slave.instantiate(callbacks=callbacks)
    assert said[0].startswith(f"valve: the GUID {guid}")
    assert "this is dcv {" in said[0]


def test_a_state_heals_a_refusal(unpacked) -> None:
    """A master may go back to the last good state after a refused value."""
    slave = Instance(unpacked["dcv"]).initialise()
    slave.play([[0.5]] * 10)
    data, good = slave.state_bytes(), slave.get("spool")
    assert slave.status(slave.fmu.setReal, [slave.vr["demand"]], [float("nan")]) == ERROR
    assert slave.step(0.01) == ERROR
    broken = slave.state_bytes()
    slave.restore_bytes(data)
    assert slave.get("spool") == good
    assert slave.step(0.01) == OK
    slave.restore_bytes(broken)
    assert slave.step(0.01) == ERROR, "saved after a refusal, a state does not become good by being restored"
    slave.close()


def test_a_step_that_cannot_be_computed_is_refused_in_words(unpacked) -> None:
    slave = Instance(unpacked["sensor"], "s").initialise(quantum=1e-310, bias=1e3)
    assert slave.step(0.0) == ERROR
    assert slave.messages == ["s: the step at t = 0.0 s failed: a number is no whole number within 2^53"]
    slave.close()


@settings(max_examples=150, deadline=None)
@given(st.floats(allow_nan=False).filter(lambda v: not 1e-12 <= v <= 1e9))
def test_numbers_are_written_as_python_writes_them(unpacked, value) -> None:
    """The shortest text that reads back as the same number."""
    if "slave" not in KEPT:
        KEPT["slave"] = Instance(unpacked["mechanical"], "m")
    slave = KEPT["slave"]
    slave.messages.clear()
    assert slave.status(slave.fmu.setReal, [slave.vr["J"]], [value]) == ERROR
    assert slave.messages[0].startswith(
        f"m: J = {value!r} is refused: it must be a number from 1e-12 to 1000000000.0; "
    )
