"""What the cube of a batch says of its axes before there is any signal."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray


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

    def write(self, store: Any) -> None:
        """Write coordinates alone into a store of zarr, as xarray does, which takes a third of a second to load."""
        import zarr

        beside = " ".join(sorted(name for name in self.columns if name != "run"))
        about: dict[str, Any] = {"label": "simulated", **self.attributes, "coordinates": beside}
        group = zarr.open_group(store, mode="w", zarr_format=2, attributes=about)
        for name, (_, unit) in self.columns.items():
            array = self._array(name)
            told: dict[str, Any] = {**({"units": unit} if unit else {}), "_ARRAY_DIMENSIONS": ["run"]}
            blank = np.nan if array.dtype.kind == "f" else None
            group.create_array(name, data=array, chunks=array.shape, fill_value=blank, attributes=told)

    def lost(self, group: Any) -> str | None:
        """The first axis or attribute that a cube does not hold as it was written."""
        for name, value in self.attributes.items():
            if group.attrs.get(name) != value:
                return name
        for name in self.columns:
            written = self._array(name)
            if name not in group or not np.array_equal(
                group[name][:], written, equal_nan=written.dtype.kind == "f"
            ):
                return name
        return None

    def _array(self, name: str) -> NDArray[Any]:
        array = np.asarray(self.columns[name][0])
        return array if array.dtype.kind in "biuf" else array.astype("U")
