"""Small logs as text and as columns, for the tests of this folder."""

import os
from pathlib import Path

import numpy as np

HEADER = "time [s],u [1],slew [deg]\n"
TOP = Path(__file__).resolve().parents[2]
MEASURED = Path(os.environ.get("COSIM_DATA", TOP.parent / "shared" / "data"))


def rows(count=30, step=0.001):
    """Data rows of a clean small log: u toggles, slew counts up by 0.5 deg."""
    return [f"{k * step:.3f},{k % 2},{k * 0.5:.1f}" for k in range(count)]


def full_log_columns(count=400):
    """Columns of a full rig log in log units, name and unit -> values: a reproducible mixture."""
    random = np.random.default_rng(7)
    time = np.arange(count) / 1000.0
    return {
        ("time", "s"): time,
        ("u", "1"): np.round(random.uniform(-1, 1, count), 3),
        ("spool", "mm"): random.normal(0, 1, count),
        ("p_supply", "bar"): 170 + random.normal(0, 0.1, count),
        ("p_a", "bar"): 90 + random.normal(0, 5, count),
        ("p_b", "bar"): 80 + random.normal(0, 5, count),
        ("slew", "deg"): 20 * np.sin(time) + random.normal(0, 0.01, count),
        ("slew_estimate", "deg"): 20 * np.sin(time),
        ("slew_rate_estimate", "deg/s"): np.cos(time),
    }


def csv_text(columns):
    """Columns as CSV text with every digit."""
    head = ",".join(f"{name} [{unit}]" for name, unit in columns)
    lines = [",".join(repr(float(value)) for value in row) for row in zip(*columns.values(), strict=True)]
    return "\n".join([head, *lines]) + "\n"
