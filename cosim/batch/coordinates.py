"""What the cube of a batch says of its axes before there is any signal."""

from collections.abc import Mapping, Sequence
from pathlib import Path

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
        """Write a dataset of coordinates alone."""
        import xarray as xr

        found = {}
        for name, (values, unit) in self.columns.items():
            array = np.asarray(values)
            array = array.astype("U") if array.dtype.kind not in "biuf" else array
            found[name] = xr.Variable(("run",), array, {"units": unit} if unit else {})
        dataset = xr.Dataset(coords=found, attrs={"label": "simulated", **self.attributes})
        dataset.to_zarr(path, mode="w", zarr_format=2, consolidated=False)
