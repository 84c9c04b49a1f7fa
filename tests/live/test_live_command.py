"""``cosim live`` as processes in real time: short runs over the loopback, and its ends by signals."""

import json
import os
import re
import signal
import socket
import struct
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import pytest

from cosim.live.link import AHEAD, STALE
from cosim.live.recorder import CHUNK
from cosim.logs import load_log

HELD_UP = 0.02  # s; processes that the machine holds up for longer lose samples, and say so
KEPT = 0.25  # s of samples that any system keeps for a process that it holds up; after a longer time the latest are gone
LONGEST = 300.0  # s for what the machine may take any time for
WHERE = re.compile(r"(?:controller|crane) at (\S+):(\d+)")


class Side:
    """A process of ``cosim live`` and the port that it listens on."""

    def __init__(self, *words, stdin=None):
        self.process = subprocess.Popen(
            [sys.executable, "-m", "cosim", "live", "--listen", "0", "--json", *map(str, words)],
            stdin=stdin or subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        assert self.process.stderr is not None
        while (found := WHERE.search(line := self.process.stderr.readline())) is None:
            assert line, "it ended"
        self.address = found[1], int(found[2])

    def end(self, code=0):
        out, error = self.process.communicate(timeout=LONGEST)
        assert self.process.returncode == code, error
        return json.loads(out)


@pytest.fixture
def side():
    """Starts sides; none outlives its test."""
    sides = []

    def start(*words, **options):
        sides.append(Side(*words, **options))
        return sides[-1]

    yield start
    for one in sides:
        if one.process.poll() is None:
            one.process.kill()
        one.process.communicate()


@pytest.fixture
def in_memory(tmp_path):
    """A folder that is never slow, where there is one."""
    if not Path("/dev/shm").is_dir():
        yield tmp_path
        return
    with tempfile.TemporaryDirectory(dir="/dev/shm") as folder:
        yield Path(folder)


def fed(address, seconds, until=lambda got: True, first=12.0):
    """A crane of the test's own: samples at about 1 kHz for so long, and on until the commands that came are as wanted.

    A crane that was held up sends no flood: its time stood still meanwhile.

    Returns:
        (how many samples went out, the commands that came, the time from the first sample on [s]).
    """
    got = []
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as link:
        link.bind(("127.0.0.1", 0))
        link.setblocking(False)
        begun = start = time.perf_counter()
        k = 0
        while (now := time.perf_counter() - start) < seconds or not until(got):
            assert now < seconds + LONGEST, "the commands are not as wanted"
            start += max(0.0, now - 1e-3 * k - HELD_UP)
            while k <= 1000 * (time.perf_counter() - start):
                link.sendto(struct.pack("<7f", first + 1e-3 * k, 170.0, 85.0, 85.0, 0.0, 0.0, 0.0), address)
                k += 1
            time.sleep(2e-4)
            try:
                while True:
                    got.append(struct.unpack("<6f", link.recv(64)))
            except BlockingIOError:
                pass
        return k, got, time.perf_counter() - begun


def all_came(told, sent):
    """Nothing is lost on the way, but for what the system drops where it holds the process up for long."""
    received = told["datagrams"]["received"]
    return received == sent or (received < sent and told["lateness"]["worst"] > KEPT)


def accounted(told):
    """Each datagram is used or said not to be, each slot has a sample or is said to have none; true of any machine."""
    counts = told["datagrams"]
    assert counts["received"] == counts["used"] + counts["surplus"] + counts["repeated"]
    without = counts["lost"] + counts["silent"]
    assert abs(told["slots"] - told["skipped"] - counts["used"] - without) <= AHEAD or told["skipped"]
    return counts


def test_the_two_ends_run_against_each_other(side, tmp_path) -> None:
    path = tmp_path / "m.csv"
    master = side("--out", path, "--automatic", "--target", "15 deg")
    crane = side(
        "--crane", "--peer", f"127.0.0.1:{master.address[1]}", "--duration", "2 s", "--effect", "sensor.bias"
    )
    own = crane.end()
    # rows are written some hundred at a time: the master has gone on long enough to know that nothing comes any more
    size, until = path.stat().st_size, time.monotonic() + LONGEST
    while path.read_bytes()[size:].count(b"\n") < STALE + 3 * CHUNK:
        assert time.monotonic() < until
        time.sleep(0.05)
    master.process.send_signal(signal.SIGTERM)
    told = master.end()
    assert (own["ended"], told["ended"]) == ("duration", "interrupted")
    counts = accounted(told)
    assert own["sent"] == 2000 - own["skipped"]
    assert all_came(told, own["sent"])
    worst = max(side["lateness"]["worst"] for side in (own, told))
    assert counts["used"] >= 1900 or worst > HELD_UP
    assert told["synthetic"]
    assert told["log"]["rows"] == told["slots"] or told["skipped"]
    assert counts["interruptions"] == 1 or (counts["interruptions"] and worst > HELD_UP), (
        "the crane ended first"
    )
    assert set(told["lateness"]) == {"unit", "p50", "p99", "p99.9", "worst"}
    log = load_log(path)
    assert log.synthetic
    assert len(log) == told["slots"] or told["skipped"]
    assert log["u"].max() > 0.3
    assert (log["u"][-100:] == 0.0).all(), "the link was down"


@pytest.mark.parametrize("number", ["SIGTERM", "SIGINT"])
def test_a_signal_ends_it_in_order(side, tmp_path, number) -> None:
    master = side("--out", tmp_path / "m.parquet", "--commands", "-", stdin=subprocess.PIPE)
    assert master.process.stdin is not None
    master.process.stdin.write("u 0.4\nenable 2\n")
    master.process.stdin.flush()
    sent, _, _ = fed(
        master.address, 1.5, lambda got: got and got[-1][0] > 0.3 and got[-1][3:] == (1.0, 1.0, 0.0)
    )
    master.process.send_signal(getattr(signal, number))
    told = master.end()
    assert told["ended"] == "interrupted"
    accounted(told)
    assert all_came(told, sent)
    log = load_log(tmp_path / "m.parquet")
    assert len(log) == told["slots"] or told["skipped"]
    assert told["slots"] >= told["datagrams"]["used"] - AHEAD
    assert not log.synthetic


@pytest.mark.skipif(not hasattr(signal, "SIGUSR1"), reason="no such signal here")
def test_a_user_signal_is_an_emergency_stop(side) -> None:
    master = side("--commands", "-", stdin=subprocess.PIPE)
    assert master.process.stdin is not None
    master.process.stdin.write("u 0.4\n")
    master.process.stdin.flush()
    fed(master.address, 0.5, lambda got: got and got[-1][0] > 0.2)
    master.process.send_signal(signal.SIGUSR1)
    _, behind, _ = fed(master.address, 0.2, lambda got: got and got[-1] == (0.0,) * 6)
    stopped = behind.index((0.0,) * 6)
    assert set(behind[stopped:]) == {(0.0,) * 6}, "it stays"
    master.process.stdin.write("quit\n")
    master.process.stdin.flush()
    told = master.end()
    assert told["emergency_stop"]
    assert told["ended"] == "quit"


@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="no such signal here")
def test_a_kill_leaves_a_log_to_the_last_second(side, in_memory) -> None:
    master = side("--out", in_memory / "m.csv")
    _, got, lasted = fed(master.address, 2.5)
    os.kill(master.process.pid, signal.SIGKILL)
    master.process.wait(LONGEST)
    log = load_log(in_memory / "m.csv")
    # each command is of a row of its own, and no row is ahead of its time
    assert len(got) - 1000 <= len(log) <= 1000 * lasted
    assert len(log) > STALE
    assert log.uniform


def test_without_a_crane_it_says_so_and_the_command_is_done(side, tmp_path) -> None:
    master = side("--duration", "300 ms", "--out", tmp_path / "m.csv")
    told = master.end()
    assert told["datagrams"]["received"] == told["slots"] == 0
    assert (tmp_path / "m.csv").read_text().startswith("time [s],u [1],spool [mm]")


@pytest.mark.parametrize(
    ("words", "code", "message"),
    [
        (["--peer", "somewhere"], 2, "should read HOST:PORT"),
        (["--crane"], 2, "it must know where to: --peer HOST:PORT"),
        (["--crane", "--peer", "127.0.0.1:9", "--automatic"], 2, "--automatic is for the controller's side"),
        (["--effect", "dcv.delay"], 2, "--effect is for the crane's side"),
        (["--crane", "--peer", "127.0.0.1:9", "--effect", "dcv.dealy"], 2, "did you mean dcv.delay"),
        (["--listen", "70000"], 2, "--listen 70000 is no port"),
        (["--bind", "203.0.113.7"], 2, "cannot listen on 203.0.113.7"),
        (["--excitation", "steps"], 2, "give --duration"),
        (["--duration", "3 bar"], 2, "--duration"),
        (["--out", "log.mat", "--duration", "1 s"], 2, "a live log is written as .csv or .parquet"),
        (["--layout", "nowhere.toml"], 3, "nowhere.toml: the layout cannot be read"),
        (["--gain", "k_q=3"], 2, "k_p"),
        (["--target", "400 deg"], 2, "from -30 to 280 deg"),
        (["--commands", "nowhere.txt"], 3, "nowhere.txt: cannot be read"),
    ],
)
def test_what_makes_no_sense_is_refused(command, words, code, message) -> None:
    found, _, error = command("live", "--listen", "0", *words)
    assert found == code
    assert message in " ".join(error.split())


def test_two_cannot_listen_on_one_port(command) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.bind(("127.0.0.1", 0))
        code, _, error = command("live", "--listen", other.getsockname()[1])
    assert code == 2
    assert "choose another --listen or --bind" in " ".join(error.split())


@pytest.mark.skipif(not hasattr(signal, "SIGSTOP"), reason="no such signal here")
def test_what_comes_while_the_process_stands_still_is_received(side, tmp_path) -> None:
    """Longer than the system keeps by itself; the word to end comes meanwhile."""
    master = side("--out", tmp_path / "m.csv")
    first, _, _ = fed(master.address, 0.1, lambda got: len(got) > 10)
    master.process.send_signal(signal.SIGSTOP)
    second, _, _ = fed(master.address, 0.35, first=20.0)
    master.process.send_signal(signal.SIGTERM)
    master.process.send_signal(signal.SIGCONT)
    told = master.end()
    assert accounted(told)["received"] == first + second
    log = load_log(tmp_path / "m.csv")
    assert len(log) == told["slots"] or told["skipped"]
    meanwhile = np.round(np.degrees(log["slew"][log.valid_mask("slew")]), 3)
    # of samples that came before their slot the oldest give way
    assert np.isin(np.round(20.0 + 1e-3 * np.arange(second), 3), meanwhile).sum() >= second - AHEAD
