"""What the tests of batches share: short requests, and the cube read back."""

from pathlib import Path
from typing import Any

import xarray as xr

from cosim.batch.plan import Plan

# the toy's steps: 0.01 s, 0.1 s long
SHORT: dict[str, Any] = {"step_size": "10 ms"}


def plan(model: Path, **more: Any) -> Plan:
    return Plan.model_validate({"model": str(model), **SHORT, **more})


def cube(folder: Path) -> xr.Dataset:
    return xr.open_zarr(folder / "signals.zarr", chunks=None).load()
