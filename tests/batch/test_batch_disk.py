"""The folder of a batch on a disk that fails: it begins again, and its journal never holds half a line."""

import contextlib
import sys
import time

import pytest
from fault_injection import failing_call, full_after

for needed in ("xarray", "zarr"):
    pytest.importorskip(needed, reason="needs the extra 'batch'")

import pandas as pd  # noqa: E402

from cosim.batch.coordinates import Coordinates  # noqa: E402
from cosim.batch.job import Outcome  # noqa: E402
from cosim.batch.store import Store  # noqa: E402
from cosim.errors import UsageError  # noqa: E402
from cosim.files import write_text  # noqa: E402


def outcome(number):
    return Outcome(number=number, status="done", seconds=0.1, worker="w", scores={"rmse": 1.0})


def coordinates():
    return Coordinates({"run": ([0, 1, 2], "")}, 0.001, 0.0, "time")


AWAY = (
    "Directory not empty",
    "No such file or directory",
)  # files come and go under the hands of who clears up


def begun(folder):
    """Begins once zarr's threads, which outlive a failed write within one process, have let go of the folder."""
    for left in reversed(range(600)):
        try:
            return Store(folder).begin({"identity": "x"}, coordinates(), fresh=False)
        except UsageError as error:
            if not left or not any(text in str(error) for text in AWAY):
                raise
            time.sleep(0.1)
    return None


def test_a_batch_whose_beginning_fails_begins_again(tmp_path):
    for at in range(1, 200):
        folder = tmp_path / str(at)
        with failing_call(at) as faults, contextlib.suppress(UsageError):  # nothing else
            Store(folder).begin({"identity": "x"}, coordinates(), fresh=False)
        assert begun(folder) == 0
        if faults.seen < at:
            return
    pytest.fail("no end of calls")


@pytest.mark.skipif(sys.platform == "win32", reason="a limit of POSIX")
def test_half_a_line_never_stays_in_the_journal(tmp_path):
    store = Store(tmp_path)
    store.begin({"identity": "x"}, coordinates(), fresh=False)
    store.add([outcome(0)])
    store.flush()
    size = store.path("journal").stat().st_size
    store.add([outcome(1)])
    with full_after(size + 20), pytest.raises(OSError, match=r"space|large"):
        store.flush()
    assert store.path("journal").stat().st_size == size
    store.flush()
    assert Store(tmp_path).begin({"identity": "x"}, coordinates(), fresh=False) == 2
    with failing_call(1), pytest.raises(OSError, match="No space"):
        write_text(store.path("runs"), "half")
    assert isinstance(store.finish({"run": [0, 1, 2]}), pd.DataFrame)
