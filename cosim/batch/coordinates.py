"""What the cube of a batch says of its axes before there is any signal."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np


class Coordinates:
    """What the cube says of its axes before there is any signal.

    Args:
        columns: name -> (value of each run, unit): parameters, models, logs.
        output_step: s.
        first_time: s, of the first point.
        time_is: what time means.
    """

    def __init__(
        self,
        columns: Mapping[str, tuple[Sequence[object], str]],
        output_step: float,
        first_time: float,
        time_is: str,
    ) -> None:
        self.columns = columns
        self.attributes = {"output_step": output_step, "first_time": first_time, "time_is": time_is}

    def write(self, path: Path) -> None:
        """Write a dataset of coordinates alone, as xarray writes one: to load xarray takes a third of a second."""
        import zarr

        beside = " ".join(sorted(name for name in self.columns if name != "run"))
        about: dict[str, Any] = {"label": "simulated", **self.attributes, "coordinates": beside}
        group = zarr.open_group(path, mode="w", zarr_format=2, attributes=about)
        for name, (values, unit) in self.columns.items():
            array = np.asarray(values)
            array = array.astype("U") if array.dtype.kind not in "biuf" else array
            told: dict[str, Any] = {**({"units": unit} if unit else {}), "_ARRAY_DIMENSIONS": ["run"]}
            blank = np.nan if array.dtype.kind == "f" else None
            group.create_array(name, data=array, chunks=array.shape, fill_value=blank, attributes=told)
