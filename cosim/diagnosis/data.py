"""A log made ready for the diagnosis: uniform in time, SI, and the free functions of each group."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy.signal import butter, sosfiltfilt

from cosim.diagnosis.freeform import Basis, changing, families
from cosim.diagnosis.groups import Group

Array = NDArray[np.float64]


@dataclass
class Record:
    """Uniformly sampled signals.

    Attributes:
        h: sample interval, s.
        signals: name -> (n,) SI, with ``p_load`` where both ports were measured.
    """

    h: float
    signals: dict[str, Array] = field(repr=False)

    @property
    def time(self) -> Array:
        """(n,) s, from zero."""
        n = len(next(iter(self.signals.values())))
        return np.asarray(np.arange(n) * self.h, dtype=np.float64)

    def has(self, *names: str) -> bool:
        """True if all of these were measured."""
        return all(name in self.signals for name in names)

    def smooth(self, name: str, cutoff: float = 5.0) -> Array:
        """A signal without what lies above `cutoff` Hz, no phase shift."""
        sections = butter(2, min(cutoff * 2.0 * self.h, 0.9), output="sos")
        return np.asarray(sosfiltfilt(sections, self.signals[name]))

    def rate(self, name: str, cutoff: float = 5.0) -> Array:
        """Time derivative of a signal, smoothed."""
        return np.asarray(np.gradient(self.smooth(name, cutoff), self.h), dtype=np.float64)


def free_bases(
    record: Record, group: Group, values: dict[str, float], predicted: dict[str, Array]
) -> dict[str, list[Basis]]:
    """The free functions for each observed signal of a group.

    They depend on what drives the group and on what the model predicts, never on the signal that is judged: that would
    explain its own noise.

    Args:
        record: the measured signals.
        group: the group.
        values: ``component.parameter`` -> SI, for its linear part.
        predicted: observed signal -> (n,) what the fitted model predicts, SI.
    """
    if group.name == "dcv":
        return valve_bases(record, values, predicted["spool"])
    if group.observed[0] == "p_load":
        return pressure_bases(record, values, predicted)
    return angle_bases(record, group, values, predicted["slew"])


def valve_bases(record: Record, values: dict[str, float], spool: Array) -> dict[str, list[Basis]]:
    """A missing demand, through the valve's second order (4.16)."""
    h, u = record.h, record.signals["u"]
    w0, zeta, K = values["dcv.w0"], values["dcv.zeta"], values["dcv.K"]
    transfer = ([K * w0 * w0], [1.0, 2.0 * zeta * w0, w0 * w0])
    drivers = {"u": u, "spool": spool, "spool_rate": np.gradient(spool, h)}
    warming = changing("u", u, record.time, transfer, h, "demand", "1")
    return {"spool": families(drivers, transfer, h, "demand", "1") + warming}


def pressure_bases(
    record: Record, values: dict[str, float], predicted: dict[str, Array]
) -> dict[str, list[Basis]]:
    """A missing opening, through the first order (4.33), and a missing supply pressure."""
    h = record.h
    K_c, T = values["continuity.K_c"], values["continuity.T"]
    drivers = {"p_load": predicted["p_load"]}
    if record.has("spool"):
        spool = record.smooth("spool", 20.0)
        drivers |= {"spool": spool, "spool_rate": record.rate("spool", 10.0)}
    else:
        spool = predicted["p_load"] / K_c  # the opening that the pressure asks for
        drivers["u"] = record.signals["u"]
    # not of the slew: nothing in the continuity depends on it, and slow noise would pass for such a dependence
    transfer = ([K_c], [T, 1.0])
    warming = changing("spool", spool, record.time, transfer, h, "opening", "m")
    found = {"p_load": families(drivers, transfer, h, "opening", "m") + warming}
    if "p_supply" in predicted:
        flow = {"abs(spool)": np.abs(spool)}
        lagged = families(flow, ([1.0], [0.3, 1.0]), h, "lagged supply", "Pa")
        found["p_supply"] = families(flow, None, h, "supply", "Pa") + lagged
    return found


def angle_bases(
    record: Record, group: Group, values: dict[str, float], slew: Array
) -> dict[str, list[Basis]]:
    """A missing torque (demand, in the simplified model) through the linear mechanics (4.28), and a missing reading."""
    h = record.h
    rate = np.gradient(slew, h)
    drivers = {"omega": rate, "theta": slew}
    if "p_load" in record.signals:
        drivers["p_load"] = record.smooth("p_load")
    elif "u" in record.signals:
        drivers["u"] = record.signals["u"]
    if group.name == "simplified":
        transfer = ([values["simplified.k"]], [1.0, values["simplified.a"], 0.0])
        what, unit = "demand", "1"
    else:
        transfer = ([1.0], [values["mechanical.J"], values["mechanical.b"], 0.0])
        what, unit = "torque", "N.m"
    warming = changing("omega", rate, record.time, transfer, h, what, unit)
    return {
        "slew": families(drivers, transfer, h, what, unit)
        + warming
        + families({"omega": rate}, None, h, "reading", "rad")
    }
