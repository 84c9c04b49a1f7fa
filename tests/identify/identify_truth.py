"""Truth and measures that the tests of the identification share."""

from scipy.stats import binom

UNCOMPENSATED = {"compensator.d_plus": 0.0, "compensator.d_minus": 0.0}
TRUTH = {  # the nominal crane
    "dcv.K": 2.375e-3,
    "dcv.w0": 25.23,
    "dcv.zeta": 0.545,
    "continuity.K_c": 5.28e8,
    "continuity.T": 0.11,
    "mechanical.J": 763.94,
    "mechanical.b": 34.9 * 763.94,
    "dead_zone.b_r": 0.45,
    "dead_zone.b_l": -0.40,
    "dead_zone.m_r": 1.0,
    "dead_zone.m_l": 1.0,
}


def inside(quantity, truth):
    """Whether the 95 % interval holds the truth."""
    low, high = quantity.interval
    return low <= truth <= high


def score(quantity, truth):
    """How far off, in standard deviations."""
    return (quantity.value - truth) / quantity.deviation


def least(trials, p=0.95, chance=1e-3):
    """The smallest number of hits of `trials` that a coverage of p leaves but for a chance."""
    return int(binom.ppf(chance, trials, p))
