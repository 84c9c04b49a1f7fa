"""Every threshold by which the diagnosis decides, in one table: value, unit, what it decides, why, where it was measured.

What only sets how finely something is computed stands beside its code. docs/thresholds.md prints the table
(``python docs/make_thresholds.py``), and that of `cosim.inference.thresholds`.
"""

from typing import Annotated

# conventions

CHI_SQUARE_95: Annotated[
    float,
    "twice log-likelihood",
    "quantile by which a profile ends an interval, and a bound is pressed",
    "95 % of chi-square with one degree of freedom",
    "convention",
] = 3.84
ONE_SIDED_95: Annotated[
    float,
    "standard deviations",
    "uncertainty that is taken off before something counts: of a trusted parameter's change, of what an effect would gain",
    "one-sided 95 % of a normal estimate",
    "convention",
] = 1.64

# naming a cause

NAMING_GAIN: Annotated[
    float,
    "log-likelihood",
    "gain beyond BIC's price that a cause must have",
    "some 30 candidates a log and at most 1 % of clean logs with a cause: ln(3000) = 8, and 2 for noise that is not quite known",
    "blind suite: 0 of 300 clean logs with a cause",
] = 10.0
INDISTINGUISHABLE: Annotated[
    float,
    "log-likelihood",
    "difference within which two explanations cannot be told apart",
    "odds of 400; on left-out windows a difference whose interval includes none counts as none, too (Vuong 1989)",
    "blind suite: true cause in the reported set in 100 % of 103",
] = 6.0
BEYOND_TRUST: Annotated[
    float,
    "standard deviations",
    "change of a trusted parameter beyond which it is itself a cause, less its own uncertainty",
    "what --tolerance promises; and the gain of any cause: with 6 of log-likelihood one clean log in 436 had a cause",
    "436 clean logs of the blind suite",
] = 3.0
SURE_SIZE: Annotated[
    float,
    "standard deviations",
    "distance of a size from its off value beyond which it is sure",
    "two-sided 95 % of a normal estimate",
    "convention",
] = 2.0
CALIBRATED_TRUST: Annotated[
    float,
    "share of the value",
    "relative trust in nominal parameters that are calibrated",
    "as good as none, and yet the order of magnitude stays",
    "not measured by itself",
] = 1.0
ROUGH_TRUST: Annotated[
    float,
    "share of the value",
    "relative trust beyond which nothing that a model predicts between its blocks is believed",
    "not even orders of magnitude are known",
    "not measured by itself",
] = 1.0
NOMINAL_TRUST: Annotated[
    float,
    "share of the value",
    "relative trust in nominal parameters unless --tolerance says another",
    "what --tolerance promises",
    "by contract",
] = 0.01
GUESSED_TRUST: Annotated[
    float,
    "share of the value",
    "relative trust in the parameters of a machine that are rough guesses",
    "any positive value of a plausible order of magnitude",
    "real logs as a whole, not by itself",
] = 30.0
IN_TURN: Annotated[
    int,
    "effects",
    "likeliest effects by the size of the error that are tried in turn",
    "the best may have a size that nobody knows",
    "the real logs as a whole, not by itself",
] = 3
RIVAL_WITHIN: Annotated[
    float,
    "share of the gain",
    "distance behind the chosen set within which a rival is fitted until it settles",
    "a search that was given up half-way would hide a rival that cannot be told apart",
    "blind suite as a whole, not by itself",
] = 0.05
SINGLE_WITHIN: Annotated[
    float,
    "share of the gain",
    "the same of a single effect in the place of the one chosen",
    "its local minimum may be long and narrow: a gear ripple over 1.6 deg was given up half-way",
    "a log of the blind suite with gravity named for a ripple",
] = 0.5
LARGEST_FORM: Annotated[
    float,
    "typical sizes",
    "largest parameter of a law's other form",
    "friction that builds up over all of a drive's speeds is viscous",
    "not measured by itself",
] = 40.0
USUAL_SIZE: Annotated[
    float,
    "typical sizes",
    "size beyond which an effect hardly ever occurs, so that a usual one goes first where the two cannot be told apart",
    "a drive at rest is held by friction rather than watched by a sensor that reads a thirtieth of the angle",
    "blind suite as a whole, not by itself",
] = 5.0
PRESSED_GAIN: Annotated[
    float,
    "log-likelihood",
    "gain beyond a physical bound of its parameter at which a cause is impossible",
    "chance gives one estimate in forty as much, if the truth lay on the bound",
    "blind suite and real logs: a cause at such a bound was always a wrong one",
] = 0.5 * CHI_SQUARE_95
RANGE_EDGE: Annotated[
    float,
    "share of the range",
    "distance from the end of a physical range at which an estimate was stopped there",
    "a step of the search goes at most 99.5 % of the way to a bound",
    "a clean log whose pressures were labelled wrong: inertia 9.99 times nominal, of 10 at most",
] = 1e-2
ORIGINS_TRIED: Annotated[
    int,
    "explanations",
    "causes in the blocks before that are tried, the most promising first",
    "each takes a fit of the block behind",
    "not measured by itself",
] = 2
STRAINED_START: Annotated[
    float,
    "standard deviations",
    "distance of a parameter from its prior beyond which the search also begins at its prior",
    "what a parameter was strained to in the absence of a cause hides the cause",
    "blind suite as a whole, not by itself",
] = 3.0

# which candidates are fitted, and how far

LAGGING: Annotated[
    float,
    "log-likelihood",
    "distance behind the best, or half the best's gain, beyond which a candidate is given up after the first rounds",
    "further rounds will not make up as much",
    "blind suite as a whole, not by itself",
] = 30.0
STILL_GAINING: Annotated[
    float,
    "log-likelihood",
    "gain of a few more quick rounds for which a rival is fitted to the end",
    "less than a sixth of what tells two explanations apart",
    "not measured by itself",
] = 1.0
SETTLED_GAIN: Annotated[
    float,
    "log-likelihood",
    "gain of further rounds below which a fit is taken as it is",
    "far below any difference that decides",
    "not measured by itself",
] = 0.1
BEHIND_BASE: Annotated[
    float,
    "log-likelihood",
    "distance behind the model without the candidate at which it is given up whatever the others gain",
    "it should gain, and has not begun to",
    "not measured by itself",
] = 3.0
ASTRAY: Annotated[
    float,
    "log-likelihood",
    "lead of a set with fewer freed parameters from which a search begins again where that one ended",
    "a set that frees more can always do as well",
    "not measured by itself",
] = 1.0
PROMISING: Annotated[
    int,
    "candidates",
    "further effects that are always fitted, the most promising by the score test first",
    "the score test is linear, and a limit is not",
    "blind suite as a whole, not by itself",
] = 4
NOT_MADE_UP: Annotated[
    float,
    "share of the change",
    "part of a candidate's change that free parameters must leave for it to be a candidate",
    "less is one number with them: it cannot be told from what is fitted freely",
    "real logs as a whole, not by itself",
] = 0.02
HOPELESS: Annotated[
    float,
    "share of the gain needed",
    "promise of a small dose below which a candidate is not fitted in an exchange",
    "the promise bounds what a small dose can gain",
    "blind suite as a whole, not by itself",
] = 0.5
UNSEEN_LIMIT: Annotated[
    float,
    "log-likelihood",
    "gain below which a limit is not met and stays where it was",
    "the data say nothing of a limit beyond the signal's extreme",
    "blind suite as a whole, not by itself",
] = 1.0
PASSED_BY_CHANCE: Annotated[
    float,
    "probability",
    "probability with which noise alone carries a reading as far beyond a limit as makes it none",
    "a limit holds every reading; one in a thousand logs may be wronged",
    "not measured by itself",
] = 1e-3
GIVES_WAY: Annotated[
    float,
    "share of the travel",
    "how far beyond a limit readings may go and it is one still",
    "a stop is elastic, and logs end at places a little apart: an excavator's arm 0.1 to 1 deg of 120",
    "not measured by itself",
] = 0.05
NEAR_STOP: Annotated[
    float,
    "share of the way",
    "part of the way to a stop from which on a window may have met it",
    "noise and a search's steps hide the last hundredth",
    "not measured by itself",
] = 0.99
WINDOWS_LEFT: Annotated[
    float,
    "share of the windows",
    "part of the windows clear of stops that is needed to begin the search there",
    "of fewer the nominal parameters are not known",
    "not measured by itself",
] = 0.25
IN_VAIN: Annotated[
    int,
    "effects",
    "effects one after the other that make nothing noticeably better on held-out data, after which no more is looked for",
    "some help together only: a friction and a load, a valve's damping and a flow taken up by the load",
    "35 diagnoses of real logs: 0.42 of the error left in the median, processor time 25 s in the median, 60 s at most; 39 and 108 s without an end",
] = 2
FEWEST_SAMPLES: Annotated[
    int,
    "samples",
    "shortest log that is judged",
    "three windows of twenty: of fewer nothing is learned of the noise",
    "random systems (benchmarks/any_system.py), as a whole",
] = 60
SEARCH_BUDGET: Annotated[
    float,
    "share of the time",
    "part of --budget that naming causes may take",
    "the rest is for the extended model, its gain and the report",
    "swing of the excavator: 30 s took 27",
] = 0.7
NAMING_BUDGET: Annotated[
    float,
    "share of the time",
    "part of a group's time that naming may take with --held-out",
    "the rest is for the data that judge the names",
    "not measured by itself",
] = 0.7
FAST_SAMPLING: Annotated[
    float,
    "s",
    "sampling interval up to which each sample is one step of the simulation",
    "the drive has no news between such samples",
    "not measured by itself",
] = 1e-3
STEP_ERROR: Annotated[
    float,
    "noise (rms)",
    "change of the whitened residual by longer steps that a search may have",
    "five times as careful as first tried: on two real logs coarser steps changed the answer",
    "real logs as a whole, not by itself",
] = 0.02
STEP_ERROR_OF_CHANGE: Annotated[
    float,
    "share of the change",
    "the same, of what a candidate changes",
    "a candidate that changes much is out or in by far more than that",
    "real logs as a whole, not by itself",
] = 0.05
STEP_ERROR_AFTER: Annotated[
    float,
    "share of both",
    "part of both that is allowed once the search is over",
    "figures that are printed come from it",
    "real logs as a whole, not by itself",
] = 0.1
FINE_STEP_SHARE: Annotated[
    float,
    "sampling intervals",
    "longest step of a simulation that is not asked for another, where that is more than 1 ms",
    "a log shows nothing that happens within a hundredth of its interval",
    "cascaded tanks at 0.25 Hz: 7 s in place of 42 with the whole log in place of a part",
] = 0.01
LONGEST_STEP_SHARE: Annotated[
    float,
    "sampling intervals",
    "longest step of a search",
    "a step must end at the samples",
    "real logs as a whole, not by itself",
] = 0.25

# adequacy: what is left, and what stands out

SYSTEMATIC: Annotated[
    float,
    "probability",
    "chance below which what free functions explain is systematic, counting all tests",
    "counting all tests, one clean log in a hundred thousand, were the noise known exactly",
    "blind suite: 2 of 335 clean logs called unexplained",
] = 1e-5
AS_A_CONSTANT: Annotated[
    float,
    "share of a signal's spread",
    "what a model leaves of a signal that moves, from which it follows nothing of it and is not adequate",
    "a constant reading would leave all of it",
    "not measured by itself; 0.95 of effects at ports, too",
] = 0.95
MOVES_BEYOND: Annotated[
    float,
    "noise of a sample",
    "spread from which a signal moves, whatever the noise learned of a model's errors says",
    "noise slower than a window of its floor adds to that, not five times as much",
    "not measured by itself",
] = 5.0
SHOWN_AGAIN: Annotated[
    float,
    "log-likelihood",
    "gain of free functions in windows other than those they were fitted in",
    "odds of 400, as between two explanations",
    "blind suite as a whole, not by itself",
] = INDISTINGUISHABLE
AGAIN_SHARE: Annotated[
    float,
    "share of the gain",
    "part of what they gain where they were fitted that they must gain there",
    "a fault gains nearly as much, slow noise that fits twice by chance up to 0.29",
    "530 logs, 100 of them with 1/f noise; in one of 300 since, 0.42",
] = 1.0 / 3.0
CERTAIN: Annotated[
    float,
    "probability",
    "chance below which they need not gain there",
    "slow noise has explained itself to 1e-11 only",
    "blind suite as a whole, not by itself",
] = 1e-30
LARGE_REST: Annotated[
    float,
    "noise of a bin",
    "size beyond which they need not gain there",
    "slow noise has explained itself to 0.61 of it at most, faults to thousands",
    "some 3700 logs",
] = 1.0
NOTICEABLE: Annotated[
    float,
    "noise of a bin",
    "size below which what is systematic does not matter",
    "it changes nothing that anybody does with the model",
    "not measured by itself",
] = 0.1
LEFT_BY_ONE: Annotated[
    float,
    "share of the residual",
    "part of the systematic residual that one cause may leave where nominal parameters are trusted",
    "a model that is right to 1 % leaves no more; real machines, whose parameters are fitted freely, are not judged by it",
    "blind suite: causes left out of the library",
] = 0.1
LEFT_BY_SEVERAL: Annotated[
    float,
    "share of the residual",
    "the same of several causes",
    "a sum of two imitates a third more easily",
    "blind suite: causes left out of the library",
] = 0.05
LEFT_BY_LINEAR: Annotated[
    float,
    "share of the residual",
    "the same where the law has one form only, as that of a nominal parameter",
    "there is no other form that could leave a rest",
    "blind suite as a whole, not by itself",
] = 0.01
LAW_KNOWN_TO: Annotated[
    float,
    "share of what it explains",
    "rest of a named cause that its law's form may leave before it is mentioned",
    "friction, stops and play have more than one law",
    "a log of LuGre friction left 1 to 4 %",
] = 0.05
STRAIN_MARGIN: Annotated[
    float,
    "standard deviations",
    "distance beyond the limit of trust at which a trusted parameter that no cause frees is a rest",
    "at the limit itself it would be a cause, were one worth naming",
    "not measured by itself",
] = 1.0
ROUNDING_SHARE: Annotated[
    float,
    "rounding",
    "change of a signal by a trusted parameter that rounding may have made",
    "half a step is what rounding is off by",
    "not measured by itself",
] = 0.5
SYSTEMATIC_SHARE: Annotated[
    float,
    "probability",
    "chance below which a signal's rest counts in the shares of the localisation",
    "stricter than `SYSTEMATIC`: a share is no verdict, and should not flicker",
    "not measured by itself",
] = 1e-6
LOCAL: Annotated[
    float,
    "probability",
    "chance below which an event, a line or a slow oscillation stands out, counting all stretches, bands and frequencies",
    "as for free functions",
    "1820 tests of stretches in clean logs: the smallest 3e-2",
] = 1e-5
LINE_PERIODS: Annotated[
    int,
    "periods",
    "periods of a line in a window",
    "of fewer a line is a slope",
    "not measured by itself",
] = 2
INDEPENDENT_VALUES: Annotated[
    float,
    "share of the values",
    "values of a stretch that count as independent",
    "noise is neither quite white nor quite normal: with all of them the smallest probability was 2e-3, with this share 3e-2",
    "180 logs of white, correlated and 1/f noise",
] = 0.8
INDEPENDENT_OF_LINE: Annotated[
    float,
    "share of the values",
    "the same of a line",
    "its neighbourhood is not quite flat: with 0.8 the smallest probability was 1e-5",
    "1250 tests in clean logs",
] = 0.6
LEAST_LOCAL_NOISE: Annotated[
    float,
    "noise of a bin",
    "smallest size of the rest against which something stands out",
    "in a computed log next to nothing is left, and none of it stands out",
    "computed logs",
] = 0.1
EVENT_EDGE: Annotated[
    float,
    "standard deviations",
    "excess of its neighbours down to which a stretch belongs to an event",
    "where it began and ended, for the report",
    "not measured by itself",
] = 4.0
FEWEST_STRETCHES: Annotated[
    int,
    "stretches",
    "stretches of one length that are needed to tell one that stands out",
    "of fewer the rest is not known",
    "not measured by itself",
] = 8
FEWEST_BINS_OF_LINE: Annotated[
    int,
    "bins",
    "shortest window in which a line is looked for",
    "its neighbourhood must hold enough frequencies",
    "not measured by itself",
] = 60
OSCILLATION_PERIODS: Annotated[
    int,
    "periods",
    "periods of a slow oscillation in a log",
    "of fewer it is a drift",
    "600 tests in clean logs: the smallest probability 4e-4",
] = 5
OFF_THE_MOTION: Annotated[
    float,
    "share of the power",
    "part of an oscillation that must not lie along the motion",
    "a motion that itself oscillates there explains it",
    "out-of-library faults of the second simulator, as a whole",
] = 0.1
CHANCES_A_FREQUENCY: Annotated[
    float,
    "chances",
    "independent chances in a frequency of one period a log",
    "frequencies are looked at more finely than one period a log",
    "noise from white to a random walk",
] = 3.0
VALUES_A_TAPER: Annotated[
    int,
    "values",
    "values for each taper that a log must have",
    "of fewer tapers leak",
    "not measured by itself",
] = 20

# held-out data and the linear reference

NESTED: Annotated[
    float,
    "ratio of errors",
    "error of a part of a set over that of the set, in the fitted log, below which the set's search went astray",
    "a set leaves no more than a part of it; a tenth is left to differences of what was fitted and what is printed",
    "excavator, arm: an end of the travel with gravity left 32 deg, the same with a rate limit that is never met 3.5 deg",
] = 0.9
AS_WELL: Annotated[
    float,
    "times the error",
    "error on held-out data within which a rival predicts as well, and a linear model no better",
    "parts of one log have more in common than an interval over them knows",
    "real logs as a whole, not by itself",
] = 1.1
CANCELLING: Annotated[
    float,
    "correlation",
    "correlation of two causes' sizes beyond which their sum is known only",
    "to a fifth of either's deviation",
    "real logs as a whole, not by itself",
] = 0.98
RIVALS_HELD_OUT: Annotated[
    int,
    "rivals",
    "closest rivals that are held against a cause on held-out data",
    "each takes a fit",
    "not measured by itself",
] = 3
LEAST_SPREAD: Annotated[
    float,
    "share of the mean variance",
    "variance of a log, or a quarter of one, by which its error counts at least",
    "where a reading stands still an error over its variance is without bound, and one such quarter would decide",
    "20 logs of a small excavator: a quarter of 0.03 counts, one at a supply's end does not decide",
] = 0.1
FREE_RUN_PARTS: Annotated[
    int,
    "parts",
    "parts of a log that count as independent repetitions in intervals of a free run",
    "what a free run is off by goes on, so neighbouring windows are no repetitions",
    "real logs as a whole, not by itself",
] = 12
FOLDS: Annotated[
    int,
    "parts",
    "parts of one log that are left out in turn, as logs are of several",
    "a quarter has strokes enough to judge by, and the estimate without it is a step from that of all",
    "20 real logs, each alone (benchmarks/each_alone.py): two logs of an axis agree on 63 of 99 sizes, with windows on 22 of 67",
] = 4
REFERENCE_WINDOWS: Annotated[
    int,
    "windows",
    "windows of which the linear reference may be called better",
    "of five all may favour one side by chance in more than 5 % of cases (sign test, both sides)",
    "sign test",
] = 6
REFERENCE_PARTS: Annotated[
    int,
    "parts",
    "parts of the held-out data beside which a linear reference is held, where windows are fewer",
    "twice the fewest of which it may be called better; more would say no more",
    "a flexible robot arm of 10 s (DaISy), whose three windows left a missing mode unsaid",
] = 12
PART_CROSSINGS: Annotated[
    int,
    "changes of sign",
    "of the error in each such part, at least",
    "four swings: neighbouring parts of an error that drifts would count it twice",
    "not measured by itself",
] = 8
BOTH_WAYS: Annotated[
    float,
    "of the farther end",
    "that the command of a log goes the other way, from which a proposed experiment goes as far both ways",
    "what goes less far back was not meant to: nobody knows that the machine bears it",
    "not measured by itself",
] = 0.5
LEFT_TO_POLES: Annotated[
    float,
    "part of the variance",
    "that a linear model explains and causes leave to it, up to which they are no stand-in for its poles",
    "one lag in the place of two leaves 13 to 46 % of what the second adds",
    "a motor's friction of one direction (HSM150, 20 s), which left a thousandth",
] = 0.05
SENSOR_MOVED: Annotated[
    float,
    "standard deviations",
    "change of a sensor's error for which the blocks are judged again",
    "less than that is its own uncertainty",
    "not measured by itself",
] = 3.0

# noise, windows and timing

BIN: Annotated[
    float,
    "s",
    "span averaged into one value",
    "the drive has no news above some 10 Hz",
    "not measured by itself",
] = 0.01
WINDOW: Annotated[
    float,
    "s",
    "window with an initial offset of its own, and unit of what is left out",
    "integrating blocks drift; long beside the motion, short beside the log",
    "not measured by itself",
] = 5.0
WINDOW_SAMPLES: Annotated[
    int,
    "samples",
    "samples of such a window, at least: a slow process is sampled slowly and its windows are longer",
    "noise slower than a sample must be told from white noise within a window",
    "cascaded tanks at 0.25 Hz, rig logs at 1 and 10 Hz, as a whole",
] = 50
FEWEST_WINDOWS: Annotated[
    int,
    "windows",
    "windows of the shortest log",
    "one of three is held out",
    "random systems (benchmarks/any_system.py), as a whole",
] = 3
UNSETTLED: Annotated[
    float,
    "s",
    "start of a log that does not count",
    "the state in which a log begins is not known",
    "not measured by itself",
] = 0.5
UNSETTLED_SHARE: Annotated[
    float,
    "share of the log",
    "the same of a short log, at most",
    "something must be left to judge",
    "random systems (benchmarks/any_system.py), as a whole",
] = 0.1
SKEW: Annotated[
    float,
    "sampling intervals",
    "standard deviation of the timing between two signals, for each block between them",
    "explicit steps of 1 ms shift each block by half a sample, two of these; half a millisecond would hide delays of 2 ms",
    "second simulator: 25 of 28 logs in explicit steps exact",
] = 0.25
SKEW_INTERVAL: Annotated[
    float,
    "s",
    "longest interval that counts for it",
    "slower logs are no worse in step",
    "second simulator",
] = 1e-3
SPARSE_SAMPLING: Annotated[
    float,
    "s",
    "sampling interval beyond which nobody knows what a signal did between two samples",
    "the drive has news up to some 10 Hz: a step of the command lies anywhere between two stamps",
    "rig logs thinned to 10 and 1 Hz",
] = 0.05
SPARSE_OF_INTEGRAL: Annotated[
    float,
    "s",
    "the same for blocks that integrate what drives them",
    "an integral takes the mean over an interval, which straight lines give while the drive's own lag is not far shorter",
    "rig logs thinned to 10 and 1 Hz",
] = 0.5
SLOW_NOISE: Annotated[
    float,
    "bins",
    "correlation time beyond which a window's offset takes the noise up",
    "a fifth of a window",
    "not measured by itself",
] = 100.0
REMAINING: Annotated[
    float,
    "share of the spectrum",
    "part of a frequency that absorbed functions must leave for it to count",
    "of less the noise's size is a guess",
    "not measured by itself",
] = 0.6
FEWEST_FREQUENCIES: Annotated[
    int,
    "frequencies",
    "frequencies of which the noise is learned",
    "of fewer nothing is learned",
    "random systems (benchmarks/any_system.py), as a whole",
] = 4
UNEQUAL_LOGS: Annotated[
    float,
    "times",
    "ratio of the noise of two logs that one round may give",
    "a first guess may be far off, a size of zero is none",
    "not measured by itself",
] = 1e3
NOISE_SMALLER: Annotated[
    float,
    "share of the noise",
    "noise below which everything is fitted again",
    "a named cause no longer counts as noise",
    "blind suite as a whole, not by itself",
] = 0.97
TIMING_MOVED: Annotated[
    float,
    "standard deviations",
    "change of the timing's discrepancy for which everything is fitted again",
    "what a late signal looks like depends on what is predicted",
    "not measured by itself",
] = 0.5
SAME_INTERVAL: Annotated[
    float,
    "times",
    "ratio of sampling intervals within which logs have one interval",
    "53 ms by one clock is 54 ms by the next",
    "real logs as a whole, not by itself",
] = 1.1
EVEN_SAMPLING: Annotated[
    float,
    "sampling intervals",
    "distance of stamps from even ones up to which a log is sampled evenly",
    "how clocks are printed",
    "not measured by itself",
] = 0.01

# labels, samples and the tracker

USUAL_GAIN: Annotated[
    tuple[float, float],
    "times",
    "gain of a block against the nominal one that a fault may have",
    "no fault of the library goes beyond",
    "benchmarks/labels.py, as a whole",
] = (1.0 / 3.0, 3.0)
SHAPE: Annotated[
    float,
    "correlation",
    "correlation with the nominal prediction from which the shape is right",
    "a wrong label leaves the shape as it is",
    "benchmarks/labels.py, as a whole",
] = 0.8
SHAPE_ABOVE: Annotated[
    float,
    "correlation",
    "the same of a block that moves too much",
    "friction, play and stops take from a motion and from its shape, and none adds to it",
    "benchmarks/labels.py, as a whole",
] = 0.6
CLOCK_SHAPE: Annotated[
    float,
    "correlation",
    "the same where the clock itself is in question",
    "nothing but the truth comes so near",
    "benchmarks/labels.py, as a whole",
] = 0.9
CLOCK_BETTER: Annotated[
    float,
    "correlation",
    "what the blocks must answer better, in the mean, where the clock is in question",
    "a slow motion looks the same by a wrong clock where only valve and pressure were measured",
    "benchmarks/labels.py, as a whole",
] = 0.25
NEAR_AN_END: Annotated[
    float,
    "share of the travel",
    "distance from where an axis went farthest at which it is held to be at an end",
    "a stop gives way, and a joint has play",
    "not measured by itself",
] = 0.01
SCATTER_AT_END: Annotated[
    float,
    "standard deviations",
    "the same of readings that scatter",
    "the farthest of some thousand readings is that far out by chance",
    "not measured by itself",
] = 4.0
PUSHED_ON: Annotated[
    float,
    "share of the command at which half the way is made",
    "drive from which on an axis that stands is held back",
    "so pushed it moves elsewhere; less may lie within a dead zone",
    "not measured by itself",
] = 0.9
LOST_AT_ENDS: Annotated[
    float,
    "share of the way made",
    "way that an axis lost at the ends of its travel, from which on its place counts",
    "a free run ends off by what a gain errs over the way, a per cent or two; more than that an end tells of the place",
    "real excavators: 0.04 to 0.5 where an end stop is met, 0.007 where an operator touches one; rig logs: 0 without ends",
] = 0.02
STILL: Annotated[
    float,
    "share of the range",
    "motion, asked for or measured, below which a log shows one state of the machine only",
    "several times the noise of the rig's sensors, and less than the smallest step of its commands",
    "not measured by itself",
] = 0.003
MOVES: Annotated[
    float,
    "share of the range",
    "motion that the model must predict where a signal is said never to move",
    "a reading in steps may hide less, and a machine that rests",
    "benchmarks/labels.py, as a whole",
] = 0.003
BALANCE: Annotated[
    tuple[float, float],
    "share",
    "error of p_a + p_b = p_supply that is as it should be, and that is not",
    "leaks and sensors are off by a few per cent, exchanged columns by far more",
    "benchmarks/labels.py, as a whole",
] = (0.05, 0.2)
FEWEST_BLOCKS: Annotated[
    int,
    "blocks",
    "blocks that do not answer as the model's before the log is said to be of another machine",
    "one alone may be faulty",
    "not measured by itself",
] = 2
FEWEST_AT_END: Annotated[
    int,
    "samples",
    "samples at one end of a signal that make it saturated",
    "fewer are chance",
    "not measured by itself",
] = 20
AT_END: Annotated[
    float,
    "share of the samples",
    "the same of a long log",
    "fewer are chance",
    "not measured by itself",
] = 0.005
REPEATED: Annotated[
    float,
    "share of the other samples",
    "repeats elsewhere up to which a reading at its end is saturated",
    "more are readings in steps, or stale ones",
    "not measured by itself",
] = 0.02
NOISY: Annotated[
    float,
    "share of the other steps",
    "steps that turn back from which a signal has noise",
    "fewer are a signal without noise, which rests at its end",
    "not measured by itself",
] = 0.2
TRACKER_LEFT: Annotated[
    float,
    "share of the motion",
    "rest of the comparison with a tracker beyond which its label is in question",
    "a clock and a seam leave far less",
    "not measured by itself",
] = 0.1
WRAPS: Annotated[
    int,
    "jumps",
    "jumps by a whole turn that make an angle one that wraps",
    "one may be a reset",
    "not measured by itself",
] = 2
NEAR_TURN: Annotated[
    float,
    "turns",
    "distance from a whole turn that such a jump may have, and size that other jumps must stay below",
    "the motion goes on during the jump",
    "not measured by itself",
] = 0.1
BEYOND_RANGE: Annotated[
    float,
    "times the range",
    "reading up to which a signal keeps to its plausible range",
    "half as much again: faults may go beyond",
    "not measured by itself",
] = 1.5
PLAUSIBLE_SPAN: Annotated[
    tuple[float, float],
    "s",
    "length of a log of such a machine where the clock is in question",
    "from one motion to an hour",
    "not measured by itself",
] = (5.0, 3600.0)
PLAUSIBLE_STEP: Annotated[
    tuple[float, float],
    "s",
    "sampling interval likewise",
    "from ten thousand samples a second to ten",
    "not measured by itself",
] = (1e-4, 0.1)
COARSE: Annotated[
    float,
    "noise",
    "step of the readings from which rounding matters",
    "finer steps are how a file was printed",
    "blind suite as a whole, not by itself",
] = 1.5
ON_GRID: Annotated[
    float,
    "share of the readings",
    "readings that must lie on the grid",
    "a truncated value now and then is allowed",
    "blind suite as a whole, not by itself",
] = 0.995
OFF_GRID: Annotated[
    float,
    "steps",
    "distance from the grid up to which a reading lies on it",
    "how floats are printed",
    "not measured by itself",
] = 0.01
CHANCE_ON_GRID: Annotated[
    float,
    "chances",
    "one in so many readings lies on the grid by chance",
    "the width of `OFF_GRID` on both sides",
    "arithmetic",
] = 50.0
STEPS_A_SAMPLE: Annotated[
    float,
    "steps",
    "motion from sample to sample below which readings in steps may repeat by themselves",
    "one step, and one that noise holds back",
    "arithmetic",
] = 2.0
JUMPED_STEPS: Annotated[
    float,
    "steps",
    "jump of readings in steps after a pause, beyond which they were not read in between",
    "a motion goes through every step; two more by noise",
    "arithmetic",
] = 3.0
TREAD_SPREAD: Annotated[
    float,
    "share of the samples between refreshes",
    "how far the samples between two refreshes of a reading may differ from the usual number",
    "two clocks that are not in step: 9 to 11 samples of ten on a wheel drive whose encoders are read every 50 ms",
    "not measured by itself",
] = 0.15
EVEN_TREADS: Annotated[
    float,
    "share of the refreshes",
    "refreshes after the usual number of samples beyond which readings are refreshed at that rate",
    "packets lost at random give no more than a half, whatever their share",
    "arithmetic",
] = 0.9
FEWEST_TREADS: Annotated[
    int,
    "refreshes",
    "fewer say nothing of a rate",
    "of random repeats, one log in 1e9 shows so many even ones",
    "arithmetic",
] = 30
SURE_REPEATS: Annotated[
    float,
    "standard deviations",
    "repeats beyond chance from which samples are stale",
    "a log has tens of thousands of samples",
    "blind suite as a whole, not by itself",
] = 6.0
MANY_REPEATS: Annotated[
    float,
    "share of the samples",
    "stale samples that matter",
    "fewer change no estimate",
    "blind suite as a whole, not by itself",
] = 0.005
COLOURED_REPEATS: Annotated[
    float,
    "times",
    "repeats at once over repeats after two samples that coloured noise may have",
    "likewise of the noise's colour",
    "blind suite as a whole, not by itself",
] = 2.5
NATURAL_REPEATS: Annotated[
    float,
    "share of the readings",
    "readings that equal the last but one beyond which repeats prove nothing",
    "readings in coarse steps repeat by themselves",
    "blind suite as a whole, not by itself",
] = 0.03
MOVING: Annotated[
    float,
    "share of the greatest speed",
    "speed below which a signal may repeat because it rests",
    "the slew stands still between motions",
    "blind suite as a whole, not by itself",
] = 0.05
RESTING_RUN: Annotated[
    int,
    "samples",
    "equal readings in a row from which on the drive may stand",
    "lost packets come in shorter runs",
    "computed logs as a whole, not by itself",
] = 20
GENTLE_START: Annotated[
    float,
    "times",
    "first step after a rest over the second up to which the drive stood",
    "after lost packets the reading jumps",
    "computed logs as a whole, not by itself",
] = 3.0
CLOCK_OVERLAP: Annotated[
    float,
    "share of the shorter record",
    "overlap of log and tracker that an offset of the clock must leave",
    "less overlap fits by chance",
    "logs with a tracker as a whole, not by itself",
] = 0.5
CLOCK_READINGS: Annotated[
    int,
    "readings",
    "the same in readings",
    "fewer fit by chance",
    "logs with a tracker as a whole, not by itself",
] = 10
CLOCK_MOTION: Annotated[
    float,
    "rad",
    "slew below which a part of the record shows no time",
    "a tracker's noise",
    "not measured by itself",
] = 1e-4
CLOCK_TRUST: Annotated[
    tuple[float, float],
    "s; relative rate",
    "offset and rate of a clock that is synchronised",
    "what a network's time service keeps",
    "not measured by itself",
] = (2e-3, 1e-5)
CLOCK_SURE: Annotated[
    float,
    "standard deviations",
    "the same against their own uncertainty",
    "two tests in each log with a tracker",
    "not measured by itself",
] = 4.0
TRACKER_EDGE: Annotated[
    float,
    "s",
    "ends of the log at which readings of a tracker do not count",
    "there the smoothed slew is not good",
    "logs with a tracker as a whole, not by itself",
] = 0.05
NEAR_SEAM: Annotated[
    float,
    "noise of a reading",
    "distance from the seam below which a reading does not count",
    "on which side it lay is chance",
    "logs with a tracker as a whole, not by itself",
] = 5.0
TRACKER_WINDOWS: Annotated[
    int,
    "parts",
    "parts of a tracker's record, of which some are held out",
    "each must hold readings enough for a mean",
    "not measured by itself",
] = 24
TRACKER_CUTOFF: Annotated[
    float,
    "Hz",
    "highest cut-off at which the slew is smoothed beside a tracker",
    "the angle has no news above, and the sensor's noise is left out",
    "logs with a tracker as a whole, not by itself",
] = 10.0
TRACKER_LOWEST_CUTOFF: Annotated[
    float,
    "Hz",
    "lowest cut-off likewise",
    "below it the motion itself is smoothed",
    "logs with a tracker as a whole, not by itself",
] = 0.5

# long logs and what is said of them

LONGEST: Annotated[
    float,
    "s",
    "log that the fits use at most",
    "the cost of a longer log is that of reading it",
    "benchmarks/growth.py",
] = 300.0
LONGEST_SAMPLES: Annotated[
    int,
    "samples",
    "samples of such a log, at least, however slowly they were taken",
    "five minutes at 20 Hz; an hour of tanks at 0.25 Hz has no more to compute",
    "cascaded tanks at 0.25 Hz: of 1024 samples 74 were used",
] = 6000
LEVELS: Annotated[
    int,
    "levels",
    "levels of the command's range by which a stretch is chosen, each rising, falling and held",
    "a regime not visited is not judged",
    "not measured by itself",
] = 20
VISITED: Annotated[
    float,
    "s",
    "time after which a level counts as visited",
    "shorter than a response of the drive",
    "not measured by itself",
] = 0.2
WORSE_ELSEWHERE: Annotated[
    float,
    "times the error",
    "error in the rest of a log, against that in the stretch, from which the rest is said to differ",
    "windows of one log differ, too",
    "not measured by itself",
] = 1.5
SHORT_PIECE: Annotated[
    float,
    "s",
    "piece of the rest below which it is not judged",
    "four windows",
    "not measured by itself",
] = 20.0
SETTLING: Annotated[
    float,
    "s",
    "start of a piece that does not count",
    "the state in which it begins is not known",
    "not measured by itself",
] = 2.0
HELD_LEVEL: Annotated[
    float,
    "share of the log",
    "time for which a level of the command lasts at least",
    "of a command that never holds one, nothing is said",
    "not measured by itself",
] = 0.02
AT_ZERO: Annotated[
    float,
    "share of the command",
    "value of a command that counts as none",
    "a stick's own offset",
    "not measured by itself",
] = 0.02
LESS_THAN_NOISE: Annotated[
    float,
    "share of a signal's noise",
    "error on held-out data below which the noise is no larger than that error",
    "no model is better than the noise; by chance 100 independent samples err by a tenth less",
    "not measured by itself",
] = 0.9
UNCOMMANDED: Annotated[
    float,
    "share of the way on the command",
    "way back without a command from which on a column of the other direction is asked for",
    "a leak, a sagging load or an overrun is a small part of it",
    "a wheel loader's boom, whose joystick is recorded upwards only: 0.98",
] = 0.5
FEWEST_ITSELF: Annotated[
    int,
    "samples",
    "piece of a record in which a place may be held against the command itself",
    "a lag and a gain in each of a few windows",
    "not measured by itself",
] = 30
FAR: Annotated[
    float,
    "share of the largest command",
    "command beyond which a drive moves, whatever its dead zone",
    "looked at on both sides where a meter may show no direction",
    "a servo valve on a test stand, whose flow meter shows sizes only",
] = 0.5
INDEPENDENT: Annotated[
    float,
    "correlation",
    "correlation below which two estimates are called independent",
    "less changes no interval",
    "not measured by itself",
] = 0.01
READ_AT_START: Annotated[
    float,
    "s",
    "time at the start over which the first value of a signal is averaged, unless a mapping says another",
    "short beside the motion, long beside the noise",
    "not measured by itself",
] = 0.05
