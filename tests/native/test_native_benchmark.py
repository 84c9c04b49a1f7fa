"""The benchmark runs, its ways agree, and the order of their speeds is what it reports."""

import json
import sys

from benchmarks import native


def test_short_run_writes_figures(tmp_path, monkeypatch, capsys) -> None:
    file = tmp_path / "figures.json"
    monkeypatch.setattr(sys, "argv", ["native.py", "--duration", "1", "--repeat", "3", "--json", str(file)])
    assert native.main() == 0
    rows = json.loads(file.read_text())["rows"]
    assert [row["largest_difference"] < 1e-14 for row in rows] == [True] * 5
    python, parts, whole, _, limit = rows
    assert python["times_python_fmus"] == limit["times_limit"] == 1.0
    assert parts["times_python_fmus"] > 10.0  # 90 on a quiet machine
    assert whole["times_python_fmus"] > 10.0
    assert "limit x" in capsys.readouterr().out
