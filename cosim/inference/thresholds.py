"""Every threshold by which the inference core decides, in one table, and how such a table is read.

Each stands once, as ``NAME: Annotated[type, unit, what it is, why, where it was measured] = value``.
"""

from types import ModuleType
from typing import Annotated, NamedTuple, get_type_hints


class Threshold(NamedTuple):
    """A line of a table of thresholds.

    Attributes:
        name: as in the code.
        value: a number, or a pair.
        unit: of the value.
        what: what it is a limit of.
        why: the reason, in a sentence.
        where: on what it was measured.
    """

    name: str
    value: float | tuple[float, ...]
    unit: str
    what: str
    why: str
    where: str


def listed(module: ModuleType) -> list[Threshold]:
    """The thresholds of a module, in its order."""
    hints = get_type_hints(module, include_extras=True)
    return [
        Threshold(name, getattr(module, name), *hint.__metadata__)
        for name, hint in hints.items()
        if hasattr(hint, "__metadata__")
    ]


START_LACK: Annotated[
    float,
    "noise",
    "rest of a parabola beyond which it does not describe the first motion, so that the span is halved",
    "noise alone leaves as much as it is",
    "real logs as a whole, not by itself",
] = 2.0
START_HANGS: Annotated[
    float,
    "scatter of neighbours",
    "scatter of samples further apart beyond which noise hangs together, and a slope must be larger to be a speed",
    "a random walk has 1.7 at the shortest distance; white noise seldom more than this",
    "of logs at rest whose noise hangs together for 3 to 60 samples 1 to 3 % begin in motion, 6 to 20 % without it",
] = 1.5
START_SAMPLES: Annotated[
    int,
    "samples",
    "samples of the shortest such span",
    "a parabola has three numbers",
    "not measured by itself",
] = 10
START_SURE: Annotated[
    float,
    "standard errors",
    "size of a first value or speed that is not noise",
    "it is looked at in each signal of each log",
    "not measured by itself",
] = 5.0
START_PART: Annotated[
    float,
    "share of the mean speed",
    "speed at the first sample below which a motion only begins",
    "its parabola has a small slope at the first sample",
    "not measured by itself",
] = 0.3
START_SPAN: Annotated[
    float,
    "s",
    "longest span from the first sample in which a motion is a parabola",
    "short beside the motions of machines",
    "not measured by itself",
] = 0.1
START_STILL: Annotated[
    float,
    "share of the spread in a stretch as long",
    "spread of an output until its input first changes, up to which it stands",
    "the noise of a sensor whose readings hang together shows in no difference of two of them",
    "not measured by itself",
] = 0.02
ANCHOR: Annotated[
    float,
    "standard deviations",
    "reach of an estimate where a block is left out",
    "a stop that one window only shows must not be carried off by a straight line",
    "blind suite as a whole, not by itself",
] = 2.0
MANY_BLOCKS: Annotated[
    int,
    "blocks",
    "blocks below which their own scatter is hardly known, so that Student's quantile is taken",
    "with 12 it is an eighth above the normal one",
    "arithmetic",
] = 12
STANDS: Annotated[
    float,
    "share of a part",
    "span over which is read where a machine stands at a part's start",
    "short beside a part, long beside the noise",
    "not measured by itself",
] = 0.02
FEWEST_PARTS: Annotated[
    int,
    "parts",
    "parts into which data held out are cut at least",
    "of one or two an interval would be empty",
    "not measured by itself",
] = 8
ASKED_FOR: Annotated[
    float,
    "share",
    "causes that a fitted log asks for which a further log of the machine bears out",
    "what is known before held-out data are looked at; with it they decide by Bayes' rule",
    "third logs of an excavator and a small one (benchmarks/third_log.py)",
] = 0.8
OUTSIDE: Annotated[
    float,
    "share",
    "share that an interval leaves outside",
    "the usual 95 %: one in forty on either side",
    "convention",
] = 0.05
MOST_BLOCKS: Annotated[
    int,
    "parts",
    "parts of the data that count as repetitions at most",
    "the error of a free run is correlated over neighbouring windows",
    "real logs as a whole, not by itself",
] = 24
ORDER_WORTH: Annotated[
    float,
    "share of the error",
    "part of the error on left-out blocks that a higher order must take away",
    "an order more always fits a little better",
    "real logs as a whole, not by itself",
] = 0.02
HIGHEST_ORDER: Annotated[
    int,
    "order",
    "highest order of the linear model",
    "beyond it a block of a machine is not linear",
    "not measured by itself",
] = 6
LATEST: Annotated[
    int,
    "samples",
    "longest delay of the linear model",
    "longer ones are poles",
    "not measured by itself",
] = 20
QUICKEST_POLE: Annotated[
    float,
    "rad per sample",
    "pole beyond which it is a direct way",
    "the samples do not show it",
    "not measured by itself",
] = 1.0
SLOWEST_POLE: Annotated[
    float,
    "rad per length of the data",
    "pole below which it is an integrator",
    "the data do not show it",
    "not measured by itself",
] = 1e-4
DECAY: Annotated[
    float,
    "natural logarithms",
    "fall of a mode over the data at least",
    "an undamped mode slower than the data is a free curve, and one that rings on is the noise's",
    "real logs as a whole, not by itself",
] = 3.0
COMPUTED: Annotated[
    float,
    "share of the change from sample to sample",
    "least noise (rms) of a signal that was computed",
    "two programs that integrate the same equations differ by as much; fifteen times what the rig and the blocks differ by in the pressure",
    "rig against blocks; explicit steps of a second simulator",
] = 0.05
OWN_NOISE: Annotated[
    float,
    "of that",
    "noise between neighbouring samples from which a signal has noise of its own",
    "no log of a sensor is smoother but one (EMPS, its position)",
    "real logs as a whole, not by itself",
] = 0.25
STILL: Annotated[
    float,
    "share of the largest value",
    "the least noise of a signal that never changes",
    "a whitened residual needs a size",
    "not measured by itself",
] = 1e-6
NEGLIGIBLE: Annotated[
    float,
    "share of the spectrum",
    "power of a kind of noise at its own corner below which it is left out",
    "it changes no estimate",
    "not measured by itself",
] = 1e-3
ROUNDING: Annotated[
    float,
    "share of the largest slope",
    "slope that differences cannot tell from none",
    "rounding of double numbers under differences",
    "arithmetic",
] = 1e-8
HELD_EVERY: Annotated[
    int,
    "windows",
    "every so many windows one is held out",
    "they visit every regime of the log, and two thirds are left to fit",
    "not measured by itself",
] = 3
FITTED_WINDOWS: Annotated[
    int,
    "windows",
    "windows into which data are cut, some of which are held out",
    "thirty repetitions are many, and each window still sees the motion",
    "not measured by itself",
] = 30
BOUND: Annotated[
    float,
    "scales",
    "distance from a bound at which an unknown is held to be at it",
    "a solver stops short of a bound by rounding only; its slope there is none",
    "not measured by itself",
] = 1e-6
BETWEEN_LOGS: Annotated[
    float,
    "share of the size",
    "standard deviation from log to log of the half-normal prior",
    "two or three logs do not tell how much a parameter changes",
    "500 draws each: 95 % intervals hold in 89 to 100 %",
] = 0.5
SAME_IN_ALL: Annotated[
    float,
    "chance",
    "prior chance that a parameter is the same in all logs",
    "likewise",
    "500 draws each: 95 % intervals hold in 89 to 100 %",
] = 0.25
SAYS_NOTHING: Annotated[
    float,
    "share of the information",
    "least share in what all logs tell of a parameter with which a log is a repetition of it",
    "what a log draws is divided by its share: of next to nothing that is noise",
    "not measured by itself",
] = 0.02
