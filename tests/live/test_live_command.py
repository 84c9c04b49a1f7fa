"""``cosim live`` as processes in real time: short runs over the loopback, and its ends by signals."""

import json
import os
import re
import signal
import socket
import struct
import subprocess
import sys
import time

import pytest

from cosim.logs import load_log

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
        out, error = self.process.communicate(timeout=60)
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


def fed(address, seconds):
    """A crane of the test's own: samples at about 1 kHz; returns the commands that came."""
    got = []
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as link:
        link.bind(("127.0.0.1", 0))
        link.setblocking(False)
        start = time.perf_counter()
        k = 0
        while (now := time.perf_counter() - start) < seconds:
            while k <= 1000 * now:
                link.sendto(struct.pack("<7f", 12.0 + 1e-3 * k, 170.0, 85.0, 85.0, 0.0, 0.0, 0.0), address)
                k += 1
            time.sleep(2e-4)
            try:
                while True:
                    got.append(struct.unpack("<6f", link.recv(64)))
            except BlockingIOError:
                pass
    return k, got


def test_the_two_ends_run_against_each_other(side, tmp_path) -> None:
    master = side("--out", tmp_path / "m.csv", "--automatic", "--target", "15 deg")
    crane = side(
        "--crane", "--peer", f"127.0.0.1:{master.address[1]}", "--duration", "2 s", "--effect", "sensor.bias"
    )
    own = crane.end()
    time.sleep(0.3)
    master.process.send_signal(signal.SIGTERM)
    told = master.end()
    assert (own["ended"], told["ended"]) == ("duration", "interrupted")
    counts = told["datagrams"]
    assert counts["received"] == own["sent"] == 2000
    assert counts["used"] >= 1900
    assert told["synthetic"]
    assert told["log"]["rows"] == told["slots"]
    assert counts["interruptions"] == 1, "the crane ended first"
    assert set(told["lateness"]) == {"unit", "p50", "p99", "p99.9", "worst"}
    log = load_log(tmp_path / "m.csv")
    assert log.synthetic
    assert len(log) == told["slots"]
    assert log["u"].max() > 0.3
    assert (log["u"][-100:] == 0.0).all(), "the link was down"


@pytest.mark.parametrize("number", ["SIGTERM", "SIGINT"])
def test_a_signal_ends_it_in_order(side, tmp_path, number) -> None:
    master = side("--out", tmp_path / "m.parquet", "--commands", "-", stdin=subprocess.PIPE)
    assert master.process.stdin is not None
    master.process.stdin.write("u 0.4\nenable 2\n")
    master.process.stdin.flush()
    sent, got = fed(master.address, 1.5)
    master.process.send_signal(getattr(signal, number))
    told = master.end()
    assert told["ended"] == "interrupted"
    assert told["datagrams"]["received"] == sent
    assert max(u for u, *_ in got) > 0.3
    assert got[-1][3:] == (1.0, 1.0, 0.0)
    log = load_log(tmp_path / "m.parquet")
    assert len(log) == told["slots"] >= 1400
    assert not log.synthetic


@pytest.mark.skipif(not hasattr(signal, "SIGUSR1"), reason="no such signal here")
def test_a_user_signal_is_an_emergency_stop(side) -> None:
    master = side("--commands", "-", stdin=subprocess.PIPE)
    assert master.process.stdin is not None
    master.process.stdin.write("u 0.4\n")
    master.process.stdin.flush()
    _, before = fed(master.address, 0.7)
    master.process.send_signal(signal.SIGUSR1)
    _, behind = fed(master.address, 0.4)
    master.process.stdin.write("quit\n")
    master.process.stdin.flush()
    told = master.end()
    assert before[-1][0] > 0.2
    assert behind[-1] == (0.0,) * 6
    assert told["emergency_stop"]
    assert told["ended"] == "quit"


@pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="no such signal here")
def test_a_kill_leaves_a_log_to_the_last_second(side, tmp_path) -> None:
    master = side("--out", tmp_path / "m.csv")
    sent, _ = fed(master.address, 2.5)
    os.kill(master.process.pid, signal.SIGKILL)
    master.process.wait(10)
    log = load_log(tmp_path / "m.csv")
    assert sent - 1000 <= len(log) <= sent + 20
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
    first, _ = fed(master.address, 0.3)
    master.process.send_signal(signal.SIGSTOP)
    second, _ = fed(master.address, 0.45)
    master.process.send_signal(signal.SIGTERM)
    master.process.send_signal(signal.SIGCONT)
    told = master.end()
    counts = told["datagrams"]
    assert counts["received"] == counts["used"] == first + second
    slew = load_log(tmp_path / "m.csv")["slew"]
    assert len(slew) == told["slots"] >= first + second
