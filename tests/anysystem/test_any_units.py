"""An FMU that states no unit takes SI, and people read the log's unit."""

from pathlib import Path

import numpy as np
import pytest

from cosim.anysystem.read import read
from cosim.ssp.read import read_system


def test_readings_in_degrees_are_radians_to_an_fmu_without_units(plain: Path, tmp_path: Path) -> None:
    log, mapping = tmp_path / "log.csv", tmp_path / "log.toml"
    log.write_text("t,a,b\n0,0,0\n0.1,90,1\n0.2,180,2\n", encoding="utf-8")
    mapping.write_text(
        f'model = "{plain.as_posix()}"\ntime = {{ column = "t", unit = "s" }}\n[signals]\n'
        '"plant.y" = { column = "a", unit = "deg" }\n"command" = { column = "b", unit = "1" }\n',
        encoding="utf-8",
    )
    with read_system(plain) as system:
        (recording,), _, _ = read([log], system, mapping)
    column = recording.columns["plant.y"]
    values = recording.signals["plant.y"]
    assert np.allclose(values, [0.0, np.pi / 2.0, np.pi])
    assert (column.unit, (values[1] - column.offset) / column.factor) == ("deg", pytest.approx(90.0))
