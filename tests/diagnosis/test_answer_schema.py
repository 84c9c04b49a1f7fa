"""The published JSON Schema is the one of the answer; ``python tests/diagnosis/test_answer_schema.py`` writes it anew."""

import json
from pathlib import Path

from cosim.diagnosis.schema import Answer

SCHEMA = Path(__file__).parents[2] / "docs" / "diagnosis.schema.json"


def schema() -> str:
    """The schema as text."""
    return json.dumps(Answer.model_json_schema(), indent=2, sort_keys=True) + "\n"


def test_published_schema_is_current() -> None:
    assert SCHEMA.read_text(encoding="utf-8") == schema(), f"run: python {Path(__file__).name}"


if __name__ == "__main__":
    SCHEMA.write_text(schema(), encoding="utf-8")
