"""A MAT file with a Simulink data set, which no open library reads: the message says what to do."""

from pathlib import Path

import h5py
import numpy as np
import pytest

from cosim.errors import DataError
from cosim.logs import load_log


def test_a_simulink_data_set_is_refused_with_the_way_out(tmp_path: Path) -> None:
    file = tmp_path / "logsout.mat"
    with h5py.File(file, "w", userblock_size=512) as made:  # as MATLAB lays such a file out
        made.create_group("#sigstream#/0")["#data#"] = np.zeros(80, dtype=np.uint8)
        made["data"] = np.zeros((1, 6), dtype=np.uint32)
        made["data"].attrs["MATLAB_class"] = np.bytes_(b"Simulink.SimulationData.Dataset")
    with file.open("r+b") as stream:
        stream.write(b"MATLAB 7.3 MAT-file".ljust(124) + b"\x00\x02IM")
    with pytest.raises(DataError, match=r"Simulink data set.*writetimetable\(extractTimetable"):
        load_log(file)
