"""A log as a German logger writes it, and a page's form filled in as it stands."""

from pathlib import Path

import pandas as pd
import pytest

from cosim.api import make_log

HEADINGS = {
    "time [s]": ("Zeit (ms)", 1000.0), "u [1]": ("Ventilbefehl (%)", 100.0), "spool [mm]": ("Schieberweg (mm)", 1.0),
    "p_supply [bar]": ("Systemdruck (bar)", 1.0), "p_a [bar]": ("Druck A (bar)", 1.0), "p_b [bar]": ("Druck B (bar)", 1.0),
    "slew [deg]": ("Lage", 1.0),
}  # fmt: skip


@pytest.fixture(scope="session")
def german(tmp_path_factory) -> Path:
    """Eight seconds with 300 N m of dry friction; the angle's heading tells nobody what it is."""
    log = make_log("steps", 8.0, ["mechanical.coulomb_friction:tau_c=300 N.m"], seed=2)
    frame = log.to_frame()
    if "time [s]" not in frame:
        frame.insert(0, "time [s]", log.time)
    table = pd.DataFrame({name: (scale * frame[own]).round(9) for own, (name, scale) in HEADINGS.items()})
    file = tmp_path_factory.mktemp("german") / "Messung März.csv"
    table.to_csv(file, sep=";", decimal=",", index=False, encoding="cp1252")
    return file


@pytest.fixture
def filled():
    """The form of a state, as the page hands it back when nobody has changed anything."""

    def fill(state, **columns):
        form = state["form"]
        rows = {row["signal"]: {**row} for row in form["rows"]}
        for name, column in columns.items():
            rows[name]["column"] = column
        return {"time": dict(form["time"]), "rows": rows}

    return fill
