"""What a log would not surely have shown is listed: nothing follows from its absence."""

import math
from types import SimpleNamespace

import pytest
from hidden_logs import diagnosed
from scipy.stats import norm

from cosim.diagnosis.hypotheses import exercised
from cosim.diagnosis.thresholds import NAMING_GAIN

COUNT = 6000
SURE = NAMING_GAIN + 0.5 * math.log(COUNT)  # of an effect with one size


def listed(monkeypatch: pytest.MonkeyPatch, gain: float) -> bool:
    """Whether an effect is listed that gains so much on average."""
    effect = SimpleNamespace(name="a.b", free=("size",))
    finding = SimpleNamespace(
        chosen=SimpleNamespace(names=()),
        null=SimpleNamespace(fit=SimpleNamespace(count=COUNT)),
        task=SimpleNamespace(model=SimpleNamespace(group=SimpleNamespace(effects=lambda: (effect,)))),
    )
    monkeypatch.setattr(exercised, "exercised", lambda _finding, _tolerance: {"a.b": gain})
    return exercised.never_exercised(finding, 0.01) == ["a.b"]


def test_what_is_not_listed_is_found_in_nineteen_logs_of_twenty(monkeypatch) -> None:
    low, high = 0.0, 100.0
    assert listed(monkeypatch, low)
    assert not listed(monkeypatch, high)
    while high - low > 1e-6:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if listed(monkeypatch, middle) else (low, middle)
    # half of |d + noise|^2 less half of |noise|^2 is d^2/2 on average, and scatters by |d|
    found = norm.sf(SURE, loc=high, scale=math.sqrt(2.0 * high))
    assert found == pytest.approx(0.95, abs=1e-3)  # 1.64 for 1.645


@pytest.mark.parametrize(
    ("excitation", "never"), [pytest.param("small_steps", True, marks=pytest.mark.slow), ("steps", False)]
)
def test_orifice_flow_is_listed_where_hardly_any_pressure_stands_against_it(excitation, never) -> None:
    found = diagnosed(seed=5, excitation=excitation, blocks=("continuity",))
    assert found.verdict == "adequate"
    assert ("continuity.flow_pressure" in found.never) == never
