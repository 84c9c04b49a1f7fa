"""Model against log: per signal with the model driven by the command alone, and per block driven by what was measured.

    with Comparator(load_log("log.csv"), Path("full_order_open.ssp")) as comparator:
        comparison = comparator.run()
        print(comparison.signals["slew"].score.rmse)

docs/compare.md explains the tables.
"""

from cosim.calls import make_callable
from cosim.compare.comparator import Comparator
from cosim.compare.mapping import CompareTable, load_mapping
from cosim.compare.metrics import Score, fit_percent, noise_floor, rms
from cosim.compare.model import open_model
from cosim.compare.outcome import BlockOutcome, Comparison, SignalOutcome

__all__ = [
    "BlockOutcome",
    "Comparator",
    "CompareTable",
    "Comparison",
    "Score",
    "SignalOutcome",
    "fit_percent",
    "load_mapping",
    "noise_floor",
    "open_model",
    "rms",
]

make_callable(__name__)
