import dataclasses
from pathlib import Path

import pytest

from cosim.rig import as_log, make_log


@pytest.fixture(scope="session")
def diagnosed(made_once) -> Path:
    """Folder of one real diagnosis: Coulomb friction hidden in 25 s of the rig, with its report."""
    pytest.importorskip("plotly", reason="the extra 'report' is not installed")
    pytest.importorskip("jinja2", reason="the extra 'report' is not installed")
    from cosim.diagnosis.answer.answer import answer
    from cosim.diagnosis.pipeline.diagnose import diagnose
    from cosim.report.page import save_and_report

    def make(folder: Path) -> None:
        run = make_log("mixed", 25.0, ["mechanical.coulomb_friction:tau_c=150 N.m"], seed=4)
        log = dataclasses.replace(as_log(run), source=Path("<b>rig & co.csv"), sha256="ab" * 32)
        found = diagnose(log, folder=folder)
        result = answer(found, log, None)
        (folder / "diagnosis.json").write_text(result.model_dump_json(indent=2), encoding="utf-8")
        assert save_and_report(found, result, folder) == folder / "report.html"

    return made_once("diagnosis", make)
