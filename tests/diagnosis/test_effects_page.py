"""The table of docs/effects.md is what the registry says."""

import importlib.util
from pathlib import Path

DOCS = Path(__file__).resolve().parents[2] / "docs"


def test_the_table_is_current() -> None:
    spec = importlib.util.spec_from_file_location("make_effects", DOCS / "make_effects.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    text = (DOCS / "effects.md").read_text(encoding="utf-8")
    assert module.written(text) == text, "run: python docs/make_effects.py"
    assert "`mechanical.coulomb_friction`" in text
