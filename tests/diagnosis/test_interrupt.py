"""Ctrl-C in a diagnosis leaves what was done: a real process, a real signal."""

import json
import os
import signal
from pathlib import Path

import pytest

from cosim.diagnosis.answer.schema import Answer
from cosim.rig import make_log, write
from tests.struck import struck

pytestmark = pytest.mark.skipif(os.name == "nt", reason="a console's Ctrl-C cannot be sent to one process")


@pytest.fixture(scope="module")
def log(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A short log with friction and a smaller valve gain."""
    run = make_log(
        "steps", 12.0, ["mechanical.coulomb_friction:tau_c=120 N.m", "dcv.gain:K=2.1 mm"], seed=4, start=0.3
    )
    path = tmp_path_factory.mktemp("interrupt") / "log.parquet"
    write(run, path)
    return path


@pytest.mark.parametrize(
    ("at", "judged"),
    [
        pytest.param("dcv:", ["dcv"], marks=pytest.mark.slow),
        ("mechanical:", ["dcv", "continuity", "mechanical"]),
        pytest.param("gain on held-out", ["dcv", "continuity", "mechanical"], marks=pytest.mark.slow),
        pytest.param("report", ["dcv", "continuity", "mechanical"], marks=pytest.mark.slow),
    ],
)
def test_what_was_done_is_left(log: Path, tmp_path: Path, at: str, judged: list[str]) -> None:
    words = ["diagnose", log, "--out", tmp_path / "out", "--json"]
    done = struck(signal.SIGINT, f"diagnosis: {at}", *words, start_new_session=True)
    assert done.returncode == 130, done.stderr
    assert json.loads(done.stdout)["exit_code"] == 130
    assert f"{tmp_path / 'out'} holds what was found" in done.stderr
    answer = Answer.model_validate_json((tmp_path / "out" / "diagnosis.json").read_text(encoding="utf-8"))
    assert answer.interrupted is not None
    assert at.rstrip(":") in answer.interrupted
    assert any("interrupted" in warning for warning in answer.warnings)
    assert {row.block for row in answer.localisation} == set(judged)
    assert set(answer.not_judged) == {"dcv", "continuity", "mechanical"} - set(judged)
    # of the block that was being judged there is what was found by then
    if at.rstrip(":") in judged:
        assert any(f"{at} it was interrupted; not tried" in warning for warning in answer.warnings)
    whole = [block for block in judged if not at.startswith(block)]
    found = {cause.effect for cause in answer.causes}
    assert "dcv" not in whole or "dcv.gain" in found
    assert "mechanical" not in whole or "mechanical.coulomb_friction" in found
    assert len(whole) < 3 or answer.verdict == "explained"
    # the comparison with the nominal model is there in any case, and sees the wrong gain
    assert answer.signals["spool"].rmse > 0.05
    page = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert "interrupted" in page
    assert (tmp_path / "out" / "comparison.parquet").stat().st_size > 100_000
