"""The published JSON Schema is the one of the answer; ``python tests/diagnosis/test_answer_schema.py`` writes it anew."""

import json
from pathlib import Path

from cosim.diagnosis.answer.answer import reason
from cosim.diagnosis.answer.schema import Answer

SCHEMA = Path(__file__).parents[2] / "docs" / "diagnosis.schema.json"


def schema() -> str:
    """The schema as text."""
    return json.dumps(Answer.model_json_schema(), indent=2, sort_keys=True) + "\n"


def test_published_schema_is_current() -> None:
    assert SCHEMA.read_text(encoding="utf-8") == schema(), f"run: python {Path(__file__).name}"


def test_how_far_a_rival_lies_behind_is_told_with_what_it_means() -> None:
    assert "only 3.2" in reason(3.2, True)
    assert "known only nearly" in reason(2127.6, True)
    assert "worse by 30" in reason(30.0, False)
    assert "explains the fitted data better by 15 in" in reason(-15.2, False)
    assert "explains the fitted data as well, but" in reason(0.2, False)
    assert "110.3 in log-likelihood ahead" in reason(-110.3, True)


if __name__ == "__main__":
    SCHEMA.write_text(schema(), encoding="utf-8")
