"""The page: sections filled from the material, plotly inside, nothing loaded from anywhere."""

import hashlib
import inspect
import json
import platform
import re
from collections.abc import Iterable, Mapping
from dataclasses import replace
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any

from cosim.diagnosis.answer.schema import NamedCause, Parameter
from cosim.errors import MissingExtraError, UsageError
from cosim.files import write_text
from cosim.lexicon import speaking
from cosim.packages import project_version
from cosim.report import drive, experiment, overview
from cosim.report.evidence import free_form, pictures
from cosim.report.folder import ANSWER, PREDICTED, SERIES, keep, lexicon_of, load
from cosim.report.language import current, picture_said, picture_with, reported_in, said, separators
from cosim.report.material import Material, gather
from cosim.report.names import kind_of_motion
from cosim.report.picture import Picture, figure
from cosim.report.plain import advice, chain, quiet_blocks, quiet_signals, three_sentences
from cosim.report.words import (
    NAMES,
    NOT_MET,
    Quantity,
    block_name,
    by_error,
    called,
    doubts,
    effect_in_block,
    effect_name,
    few,
    fit_text,
    limits_met,
    number,
    odd_sentence,
    phrase,
    prose,
    signal_name,
    two_digits,
    unit_text,
    without_tracker,
)

if TYPE_CHECKING:
    from cosim.diagnosis.answer.experiment import Proposal
    from cosim.diagnosis.found import Diagnosis
    from cosim.lexicon import speaking
from cosim.diagnosis.answer.schema import Answer
from cosim.diagnosis.thresholds import INDISTINGUISHABLE

REPORT = "report.html"
_CODE = re.compile(r"`([^`]+)`")
PACKAGES = ("plotly", "jinja2", "pyarrow")
MOST_LOGS = 3  # that the head names


def need_extra() -> None:
    """Check that plotly and jinja2 are there.

    Raises:
        MissingExtraError: one is not.
    """
    try:
        import jinja2  # noqa: F401
        import plotly  # noqa: F401
    except ImportError:
        raise MissingExtraError("the HTML report", "report") from None


def save_and_report(
    found: "Diagnosis", answer: "Answer", folder: Path, proposal: "Proposal | None" = None
) -> Path | None:
    """Keep the series of a diagnosis in its folder and write its report; `diagnosis.json` is there already.

    Returns:
        The report, or None if the extra that draws it is missing (`cosim report` can make it later).

    Raises:
        UsageError: the folder cannot be written to.
    """
    keep(gather(found, answer, folder, proposal), folder)
    try:
        return write_report(folder)
    except MissingExtraError:
        return None


def write_report(folder: Path, language: str | None = None) -> Path:
    """Make `report.html` from what a diagnosis left in its folder.

    Args:
        folder: of the diagnosis.
        language: en or de; by default the one in use.

    Raises:
        DataError: the folder does not hold a diagnosis.
        MissingExtraError: plotly or jinja2 is missing.
        UsageError: the folder cannot be written to, or there is no such language.
    """
    need_extra()
    file = folder / REPORT
    material = load(folder)
    with reported_in(language or current()), speaking(lexicon_of(material.answer)):
        text = page(material)
    try:
        write_text(file, text)
    except OSError as error:
        raise UsageError(f"cannot write {file} ({error.strerror or error})") from None
    return file


def page(material: Material) -> str:
    """The whole page as text."""
    drawn: list[Picture] = []

    def shown(found: list[Picture]) -> list[Picture]:
        drawn.extend(found)
        return found

    return render(contents(material, shown), drawn)


def render(sections: dict[str, Any], drawn: list[Picture]) -> str:
    """The template filled in; `drawn` are all its pictures."""
    import jinja2
    from markupsafe import Markup, escape
    from plotly.offline import get_plotlyjs

    made = {p.key: figure(picture_said(picture_with(p, kind_of_motion))) for p in drawn}
    for one in made.values():
        one["layout"]["separators"] = separators()
    figures = json.dumps(made, separators=(",", ":"))

    @jinja2.pass_context  # so that literals come here too, and are not escaped before
    def finalized(context: Any, value: Any) -> Any:
        return said(kind_of_motion(str(value))) if type(value) in (str, float) else value

    words = {
        "light": said("Light"),
        "dark": said("Dark"),
        "without": said("without {effect}").removesuffix("{effect}"),
        "extended": said("extended model"),
        "time": f"{said('time')} [",
    }
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("cosim.report", "."),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        finalize=finalized,
    )
    environment.filters["asis"] = lambda value: Markup(escape(value))
    environment.filters["instead"] = lambda p: (
        "" if p.instead_of is None else Quantity(p, p.instead_of).nominal
    )
    environment.filters["first_large"] = lambda text: text[:1].upper() + text[1:]
    environment.filters["unit"] = unit_text
    environment.filters["signal"] = signal_name
    environment.filters["effect"] = effect_in_block
    environment.filters["block"] = block_name
    environment.filters["prose"] = prose
    environment.filters["few"] = few
    environment.filters["motion"] = kind_of_motion
    environment.filters["odd"] = lambda gain: f"{text}." if (text := odd_sentence(gain)) else ""
    environment.filters["fit"] = fit_text
    # said here, before the marks of code become elements
    environment.filters["coded"] = lambda text: Markup(_CODE.sub(r"<code>\1</code>", str(escape(said(text)))))
    environment.filters["four"] = lambda value: number(value)
    environment.filters["two"] = two_digits
    # inside a script element only "<" can do harm
    return environment.get_template("page.html.j2").render(
        sections,
        language=current(),
        words=Markup(json.dumps(words)),
        plotly=get_plotlyjs(),
        figures=figures.replace("<", "\\u003c"),
    )


def names_of(signals: Iterable[str], kept: set[str]) -> str:
    """The names that people know of those signals that are kept."""
    return ", ".join(said(signal_name(signal)) for signal in dict.fromkeys(signals) if signal in kept)


def logs_of(made: Mapping[str, str]) -> str:
    """The logs that were fitted, the first of many."""
    names = [text for name, text in made.items() if re.fullmatch(r"log(_\d+)?", name)] or ["a log"]
    return ", ".join(names[:MOST_LOGS] + ["…"] * (len(names) > MOST_LOGS))


def contents(material: Material, shown: Any) -> dict[str, Any]:
    """What the template fills in; `shown` is called with each list of pictures that the page will draw."""
    answer = material.answer
    rests = []
    for index, rest in enumerate(answer.unexplained):
        part = material.parts.get(rest.block)
        side = (
            [] if part is None else [(s, c) for found in (part.after, part.before) for s, c in found.items()]
        )
        curves = next(((s, c) for s, c in side if s in rest.what and c), None) or next(iter(side), ("", []))
        if rest.span is not None:
            found = overview.event(material, rest.block, rest.what, rest.span, f"rest-{index}")
        else:
            told = [c for c in curves[1][:2] if c.gain > INDISTINGUISHABLE]
            found = [free_form(rest.block, curves[0], c, f"rest-{index}-{k}") for k, c in enumerate(told)]
        rests.append({"rest": rest, "pictures": shown(found)})
    curve = drive.picture(material)
    drawn, left = overview.held_signals(material) + overview.signals(material), overview.residuals(material)
    quiet = {f"{kind}signal-{s}" for s in quiet_signals(answer) for kind in ("", "held-out-")}
    quiet |= {f"residual-{block}-{signal}" for block, signal in quiet_blocks(answer)}
    tracked = bool(material.tracker)
    command, seen = experiment.picture(material), overview.tracker(material)
    return {
        "answer": answer,
        "foreign": False,
        "not_exercised": [e for e in answer.not_exercised if tracked or not e.startswith("tracker.")],
        "helpful_signals": [
            line for text in answer.helpful_signals if (line := text if tracked else without_tracker(text))
        ],
        "clean": overview.nothing_to_extend(answer),
        "log_name": logs_of(answer.made),
        "told": three_sentences(material),
        "advice": advice(answer),
        "chain": chain(material),
        "doubts": doubts(answer),
        "duration": f"{material.time[-1]:.4g}",
        "rate": f"{1.0 / material.h:.4g}",
        "signals": shown([p for p in drawn if p.key not in quiet] + ([seen] if seen else [])),
        "quiet_signals": shown([p for p in drawn if p.key in quiet]),
        "quiet_signal_names": names_of(answer.signals, quiet_signals(answer)),
        "nominal": [(name, *interval(p)) for name, p in answer.nominal.items()],
        "calibrated": alone(answer),
        "drive": shown([curve] if curve else []),
        "drive_rows": drive.rows(material),
        "shares": shown([overview.shares(material)] if answer.localisation else []),
        "residuals": shown([p for p in left if p.key not in quiet]),
        "quiet_residuals": shown([p for p in left if p.key in quiet]),
        "quiet_residual_names": names_of(
            [r.signal for r in answer.localisation], {signal for _, signal in quiet_blocks(answer)}
        ),
        "causes": [cause_section(material, c, shown) for c in answer.causes],
        "rests": rests,
        "command": shown([command] if command else []),
        "files": files(material),
        "versions": {k: v for k, v in answer.made.items() if not k.startswith("log")},
        "page_versions": versions(),
        "gains": {s: answer.gain[s] for s in by_error(answer, list(answer.gain))},
        # no gain was measured: the nominal errors alone
        "plain": {}
        if answer.gain
        else {s: answer.signals[s] for s in by_error(answer, list(answer.signals))},
        "seed": seed(),
        "window": f"{overview.window(material) * material.h:.3g}",
        "windows": len(overview.held_out(material)),
    }


_NOTES = re.compile(
    r" ?\(SYSTEM [^)]*\)|the standard form of SYSTEM section \S+: |; SYSTEM section \S+"
)  # of our own notes

_OFF = re.compile(r"; \S+ \S+ is out of reach$")  # for who sets the parameter by hand

SPEED_AT = "speed of the drive at this limit"


def cause_section(material: Material, cause: NamedCause, shown: Any) -> dict[str, Any]:
    """One cause: its words, parameters and pictures."""
    from fmus import registry

    effect = registry.effects().get(cause.effect)
    _, how = phrase(cause, material)
    title = called(cause.effect) if cause.effect in NAMES else effect_in_block(cause.effect)
    met = limits_met(cause, material)
    rows = [
        (
            name,
            described(effect, cause, name),
            parameter,
            interval(parameter) if name in met else (NOT_MET, "", parameter.unit),
        )
        for name, parameter in cause.parameters.items()
    ]
    rows += [(name, SPEED_AT, speed, interval(speed)) for name, speed in cause.top_speed.items()]
    return {
        "cause": cause,
        "title": title[0].upper() + title[1:],
        "how": how,
        "toggle": effect_name(cause.effect) if f"without {cause.effect}" in material.series else "",
        "text": effect.text if effect else "",
        "looks": effect.residual if effect else "",
        "source": _NOTES.sub("", effect.source) if effect else "",
        "parameters": rows,
        "pictures": shown([replace(p, evidence=True) for p in pictures(material, cause)]),
    }


def described(effect: Any, cause: NamedCause, name: str) -> str:
    """What a parameter is, in a line; empty for an effect that is not installed."""
    if effect is None:
        return ""
    from fmus import registry

    own = effect.parameters.get(name)
    return _OFF.sub("", str((own or registry.parameter(effect.component, name)).text))


def interval(parameter: Parameter) -> tuple[str, str, str]:
    """Estimate and 95 % interval as texts with as many digits as the interval allows, and the unit of both."""
    size = Quantity(parameter, None)
    return size.value, size.interval, size.unit


def alone(answer: "Answer") -> list[tuple[str, str, str, str]]:
    """Each signal with its error before and after the model's own numbers were fitted, and the unit."""
    return [
        (name, two_digits(gain.rmse_stated), two_digits(gain.rmse_fitted), gain.unit)
        for name, gain in answer.calibrated.items()
    ]


def seed() -> str:
    """How the intervals of the gain were drawn."""
    from cosim.diagnosis.held_out.gain import measure

    found = inspect.signature(measure).parameters.get("seed")
    return "" if found is None else str(found.default)


def versions() -> dict[str, str]:
    """Versions that make the page; those of the diagnosis, which may have run elsewhere, are in its answer."""
    made = {"cosim": project_version()} | {name: version(name) for name in PACKAGES}
    return made | {"python": platform.python_version()}


def files(material: Material) -> list[tuple[str, str, str]]:
    """(name, size, SHA-256) of the log and of the diagnosis' files."""
    made = material.answer.made
    found = [(made["log"], "", made["log_sha256"])] if "log" in made else []
    if "log_held_out" in made:
        found.append((made["log_held_out"], "", made["log_held_out_sha256"]))
    if material.folder is None:
        return found
    wanted = [ANSWER, SERIES, "next_experiment.csv", PREDICTED, "extended.ssp", "extended_open.ssp"]
    wanted += sorted(p.name for p in material.folder.glob("*.ssv"))
    for name in wanted:
        file = material.folder / name
        if file.is_file():
            content = file.read_bytes()
            found.append((name, f"{len(content) / 1000:.0f} kB", hashlib.sha256(content).hexdigest()))
    return found
