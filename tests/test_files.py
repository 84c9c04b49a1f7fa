"""Every file is whole or absent, whatever fails while it is written."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest
from fault_injection import failing_call, full_after

from cosim.errors import CosimError
from cosim.files import is_left_over, whole, write_bytes, write_text
from cosim.identify.picture import save
from cosim.logs import Log, write_log
from cosim.results import Result
from cosim.ssp.write import write_archive

COUNT = 500
OLD = b"what was there before\n"


def names(folder):
    return [item.name for item in folder.iterdir()]


def result():
    time = np.arange(COUNT) / 1000
    return Result("model", time, {"a.b": np.sin(time), "a.c": time**2}, {"a.b": "rad", "a.c": "m"})


def log(path):
    time = np.arange(COUNT) / 1000
    return Log(
        time=time, source=path, warnings=(), synthetic=False, sha256="", signals={"slew": np.sin(time)},
        units={"slew": "rad"}, display={"slew": "deg"}, held=frozenset(), valid={}, gaps=(),
    )  # fmt: skip


def picture():
    from matplotlib.figure import Figure

    figure = Figure()
    figure.add_subplot().plot(np.arange(COUNT))
    return figure


WRITERS = {
    "text.txt": lambda path: write_text(path, "x" * 3000),
    "result.csv": lambda path: result().write(path),
    "result.parquet": lambda path: result().write(path),
    "result.mat": lambda path: result().write(path),
    "log.csv": lambda path: write_log(log(path), path),
    "log.parquet": lambda path: write_log(log(path), path),
    "log.mat": lambda path: write_log(log(path), path),
    "picture.png": lambda path: save(picture, path),
    "package.ssp": lambda path: write_archive({"a": bytes(3000), "b": b"b"}, path),
}


@pytest.fixture(params=WRITERS)
def writer(request, tmp_path):
    """A writer, the file that it has written before, and what it writes."""
    write = WRITERS[request.param]
    sound = write(tmp_path / request.param) or tmp_path / request.param
    content = Path(sound).read_bytes()
    path = tmp_path / "folder" / request.param
    path.parent.mkdir()
    return write, path, content


@pytest.mark.parametrize("old", [OLD, None], ids=["replaced", "new"])
def test_a_call_that_fails_leaves_old_or_new(writer, old):
    write, path, content = writer
    for at in range(1, 20):
        path.unlink(missing_ok=True)
        if old is not None:
            path.write_bytes(old)
        with failing_call(at) as faults:
            try:
                write(path)
            except (OSError, CosimError) as error:
                failed = str(error)
            else:
                failed = ""
        found = path.read_bytes() if path.exists() else None
        if faults.seen < at:
            assert at > 2, "nothing was synced and renamed"
            assert len(found) == len(content)
            return
        assert found == old if failed else len(found) == len(content)
        assert not failed or "No space left" in failed
        assert names(path.parent) == ([] if found is None else [path.name])
    pytest.fail("no end of calls")


@pytest.mark.skipif(sys.platform == "win32", reason="a limit of POSIX")
@pytest.mark.parametrize("share", [0.0, 0.3, 0.999])
def test_a_full_disk_leaves_the_old_file(writer, share):
    write, path, content = writer
    path.write_bytes(OLD)
    with (
        full_after(int(share * len(content))),
        pytest.raises((OSError, CosimError), match=r"File too large|Errno 27"),
    ):
        write(path)
    assert path.read_bytes() == OLD
    assert names(path.parent) == [path.name]


def test_a_write_that_fails_names_the_file_that_was_meant(tmp_path):
    path = tmp_path / "absent" / "file.txt"
    with pytest.raises(OSError, match="No such file") as failed:
        write_text(path, "x")
    assert failed.value.filename == str(path)
    assert str(failed.value).endswith(f"'{path}'")


def test_two_writers_leave_one_file_whole(tmp_path):
    path = tmp_path / "file.txt"
    with whole(path) as one, whole(path) as other:
        one.write_text("one" * 1000)
        other.write_text("other" * 1000)
    assert path.read_text() == "one" * 1000
    assert names(tmp_path) == ["file.txt"]


def test_links_rights_and_devices_are_kept(tmp_path):
    target = tmp_path / "target.txt"
    target.write_bytes(OLD)
    target.chmod(0o640)
    link = tmp_path / "link.txt"
    link.symlink_to(target)
    write_bytes(link, b"new")
    assert link.is_symlink()
    assert target.read_bytes() == b"new"
    assert target.stat().st_mode & 0o777 == 0o640
    write_bytes(Path(os.devnull), b"nowhere")
    assert not Path(os.devnull).is_file()


def test_ctrl_c_leaves_the_old_file(tmp_path):
    path = tmp_path / "file.txt"
    path.write_bytes(OLD)

    def interrupted():
        with whole(path) as part:
            part.write_text("half")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert path.read_bytes() == OLD
    assert names(tmp_path) == ["file.txt"]


FOREVER = """
import sys, itertools
from pathlib import Path
from cosim.files import write_bytes
for k in itertools.count():
    write_bytes(Path(sys.argv[1]), bytes([k % 256]) * 300_000)
    if k == 0:
        print("begun", flush=True)
"""


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="no SIGKILL")
def test_a_kill_at_any_moment_leaves_a_whole_file(tmp_path):
    path = tmp_path / "file.bin"
    random = np.random.default_rng(1)
    for _ in range(40):
        child = subprocess.Popen([sys.executable, "-c", FOREVER, str(path)], stdout=subprocess.PIPE)
        assert child.stdout.readline() == b"begun\n"
        time.sleep(random.uniform(0, 0.02))
        child.send_signal(signal.SIGKILL)
        child.communicate()
        content = path.read_bytes()
        assert len(content) == 300_000
        assert len(set(content)) == 1
    assert all(is_left_over(item) for item in tmp_path.iterdir() if item != path)


def test_what_is_left_over_is_known(tmp_path):
    with whole(tmp_path / "file.txt") as part:
        assert is_left_over(part)
        part.write_text("x")
    assert not is_left_over(tmp_path / "file.txt")


@pytest.mark.parametrize("name", ["🚜" * 62 + ".csv", "a" * 251 + ".csv", "b." + "c" * 253])
def test_the_longest_names_are_written(tmp_path, name):
    assert len(os.fsencode(name)) > 250
    path = write_text(tmp_path / name, "x")
    assert path.read_text() == "x"
    assert names(tmp_path) == [name]
