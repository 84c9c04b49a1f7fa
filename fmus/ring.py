"""What a signal was some time ago, from a ring of its values at the last steps."""

from typing import Any

from fmus.contract import equation

RING = 16384  # steps that the longest delay may have; a number in the equations, which know no constants


@equation
def ago(steps: float, i: int, count: float, first: float, m: Any) -> float:
    """Value so many steps ago, straight between two; i: place of the newest in m.ring, which holds `count`; `first` before."""
    back = min(steps, 16380.0)
    n = int(back)
    if n >= count:
        return first
    older = first
    if n + 1 < count:
        older = m.ring[(i - n - 1) % 16384]
    part = back - n
    return (1.0 - part) * m.ring[(i - n) % 16384] + part * older
