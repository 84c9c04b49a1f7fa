"""The form of the diagnosis as JSON; its JSON Schema is published as docs/diagnosis.schema.json."""

from typing import Literal

from pydantic import BaseModel, ConfigDict

# of the advice on how to map a log, that without which nothing that is named can be relied on
ONE_WAY = "name it as `minus` in the mapping"
ITSELF = "itself and stays with it"


class Model(BaseModel):
    """Base of all parts: nothing that is not declared."""

    model_config = ConfigDict(extra="forbid")


class Signal(Model):
    """Error of the nominal model, driven by the command alone."""

    rmse: float
    fit_percent: float
    unit: str
    noise_floor: float


class Location(Model):
    """One block driven by what was measured: its residual and what of it is systematic."""

    block: str
    signal: str
    share: float
    residual_rms: float
    noise_floor: float
    unit: str


class OfLog(Model):
    """An estimate from one of several logs alone; no interval where it says nothing."""

    value: float
    ci95: tuple[float, float] | None


class Parameter(Model):
    """An estimate with its 95 % interval; of several logs where each one draws it, and what another log would give.

    Of a parameter of an FMU `instead_of` is what the model has.
    """

    value: float
    unit: str
    ci95: tuple[float, float]
    instead_of: float | None = None
    per_log: list[OfLog] = []
    next_log_ci95: tuple[float, float] | None = None


class Correlated(Model):
    """Two estimates whose errors go together; names as in ``component.parameter``."""

    parameters: tuple[str, str]
    correlation: float


class Rival(Model):
    """Another effect, and why it is not the cause."""

    effect: str
    why_not: str


class NamedCause(Model):
    """A named cause; `component` and what follows it: where, in a system of any FMUs.

    `logs`: the files in which it is, where others of the same system contradict it; empty where it is in all.
    `top_speed`: limit of the spool -> the speed at which it holds the drive, where nothing between command and motion was
    measured: the log tells that, and hardly the limit itself. Of a drive that holds a demanded place also that of its rate.
    """

    effect: str
    block: str
    component: str | None = None
    connector: str | None = None
    parameter: str | None = None
    where: Literal["input", "output", "sensor"] | None = None
    parameters: dict[str, Parameter]
    evidence: dict[str, float]
    rivals: list[Rival]
    indistinguishable_from: list[str]
    logs: list[str] = []
    top_speed: dict[str, Parameter] = {}


class RefusedCause(Model):
    """A cause that the fitted data ask for and the held-out data do not bear out, or that leaves too much.

    Of a system of FMUs `parameters` has its numbers where it is one of the causes that come nearest. `instead` is the named
    cause in whose place it explains the fitted data alike.
    """

    effect: str
    block: str
    why: str
    instead: str | None = None
    parameters: dict[str, Parameter] = {}


class ShownSignal(Model):
    """Unit and words for a signal; `scale` is the shown value per value of the model's variable, SI."""

    unit: str
    scale: float
    text: str


class Words(Model):
    """Units and words of a machine that is not the crane; `values`: ``component.parameter`` -> SI before the diagnosis."""

    signals: dict[str, ShownSignal] = {}
    units: dict[str, str] = {}
    blocks: dict[str, str] = {}
    values: dict[str, float] = {}


class Packages(Model):
    """Files of the extended model.

    `in_place`: the linear model that stands in the place of the blocks, where they lack its dynamics; None where the
    extended model is the blocks with the causes.
    """

    ssp: str
    ssv: str
    in_place: str | None = None


class LogGain(Model):
    """The same of one of several held-out logs."""

    log: str
    rmse_before: float
    rmse_after: float


class SignalGain(Model):
    """Error on held-out windows, before and after the extension.

    `horizon`: s after which the prediction begins anew where the machine stands; None for one run over the whole log.
    `per_log`: where several logs were held out.
    """

    rmse_before: float
    rmse_after: float
    unit: str
    noise_floor: float
    fit_percent_before: float
    fit_percent_after: float
    ci95_of_ratio: tuple[float, float]
    horizon: float | None = None
    per_log: list[LogGain] = []


class Calibration(Model):
    """Error on held-out windows with the numbers that a model states, and with those that were fitted to the log."""

    rmse_stated: float
    rmse_fitted: float
    unit: str
    ci95_of_ratio: tuple[float, float]


class LinearReference(Model):
    """A linear model of free order from the command to a signal, on the same held-out data as the extended model.

    The best of its order or less: a bar. `ahead` rests on the order that these data had no part in.
    `poles` in 1/s, real and imaginary part; `rmse_extended` is the extended model's error in the same windows.
    """

    order: int
    poles: list[tuple[float, float]]
    delay: float
    what: str
    rmse: float
    rmse_extended: float
    unit: str
    ci95_of_ratio: tuple[float, float]  # of the extended model's error over the linear one's
    ahead: bool = False  # surely better than the extended model: linear dynamics are missing


class MissingFunction(Model):
    """What a model of any FMUs lacks: a function that would explain it, and where it enters."""

    enters_at: list[str]  # several where the log cannot tell
    depends_on: str | None  # a connector, or "speed of" one, per s; none where it takes several
    share: float  # of the variance of what is left, that it explains on windows held out
    points: list[tuple[float, float]]  # (value of that signal, of the function), in the units of the log


class Unexplained(Model):
    """Something systematic that no effect of the library explains."""

    block: str
    what: str
    residual_rms: float
    unit: str
    span: tuple[float, float] | None = None  # s, where only one stretch of the log is off
    missing: MissingFunction | None = None


class NextExperiment(Model):
    """What to measure next, and why."""

    why: str
    excitation: dict[str, float | str | list[float]]
    predicted_gain: float
    file: str | None = None


class Separable(Model):
    """What the measured signals can tell apart in principle."""

    residual: list[str]
    effects: list[str]


class DataFinding(Model):
    """A label of the log that its data contradict; `factor`: by which the values are too large as labelled."""

    signal: str
    finding: str
    remedy: str
    factor: float | None = None


class DriveReading(Model):
    """A command as it stands in the file."""

    value: float
    ci95: tuple[float, float]
    column: str


class DriveNumber(Parameter):
    """A number of the static curve; the interval is that of the next log of the machine."""

    reading: DriveReading | None = None


class DriveCurve(Model):
    """The static curve of the drive, speed against command; sides that were not driven and tops not reached are missing."""

    command: dict[str, str]  # signal, unit
    motion: dict[str, str]
    dead_zone: dict[Literal["low", "high"], DriveNumber]
    slope: dict[Literal["low", "high"], DriveNumber]
    top_speed: dict[Literal["low", "high"], DriveNumber]
    lag: dict[str, float | str]  # value, unit
    points: list[tuple[float, float, float, float]]  # command, speed, its 95 % band
    simulated: list[
        tuple[float, float, float | None]
    ] = []  # command, speed of the model, of the extended model
    error: dict[str, float | str]  # of the speed over half a second: value, unit
    logs: list[str]
    holds: str


class Answer(Model):
    """The whole diagnosis; "interrupted" is the verdict of one that Ctrl-C ended before all blocks were judged."""

    verdict: Literal[
        "adequate", "explained", "partly_explained", "unexplained", "implausible_data", "interrupted"
    ]
    synthetic: bool
    model: str
    signals: dict[str, Signal]
    localisation: list[Location]
    causes: list[NamedCause]
    extended: Packages | None
    gain: dict[str, SignalGain]
    unexplained: list[Unexplained]
    next_experiment: NextExperiment | None
    not_exercised: list[str]
    at_rest: bool = False  # nothing moves in the log: it could have shown none of the effects
    not_judged: dict[str, str]
    isolability: list[Separable]
    helpful_signals: list[str]
    nominal: dict[str, Parameter]
    warnings: list[str]
    advice: list[str] = []  # how to record or map a log that tells more
    held_out: str = "every third window of the log"
    held_out_from: float | None = None
    refused: list[RefusedCause] = []
    data: list[DataFinding] = []  # with the verdict implausible_data
    linear: dict[str, LinearReference] = {}  # signal -> the linear reference, command to signal
    linear_blocks: dict[
        str, LinearReference
    ] = {}  # the same of each block, driven by what was measured before it
    calibrated: dict[str, Calibration] = {}  # signal of an FMU -> what fitting its parameters freely gains
    words: Words = Words()
    correlations: list[Correlated] = []  # of pairs beyond 0.01; all others are independent
    interrupted: str | None = None  # the stage in which Ctrl-C ended it
    span: tuple[float, float] | None = None  # s of the log that the fits used, where the log is longer
    drive_curve: DriveCurve | None = (
        None  # of a drive whose command and motion are measured and nothing between
    )
    made: dict[str, str]
