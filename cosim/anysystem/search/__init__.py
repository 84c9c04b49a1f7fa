"""The search in one group: `known` without a cause, `fits` of causes, `screening`, `rivals`, `decisions`, `search` the loop.

Each imports those before it alone; `finding` is what they hand on.
"""

from cosim.anysystem.search.decisions import SCATTERS
from cosim.anysystem.search.finding import Candidate, Finding, Trust, errors, extended, worth
from cosim.anysystem.search.fits import CLOSE, NAMED
from cosim.anysystem.search.known import JITTER, MOST_COARSE
from cosim.anysystem.search.search import Search

__all__ = [
    "CLOSE",
    "JITTER",
    "MOST_COARSE",
    "NAMED",
    "SCATTERS",
    "Candidate",
    "Finding",
    "Search",
    "Trust",
    "errors",
    "extended",
    "worth",
]
