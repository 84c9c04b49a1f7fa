"""A synthetic log and the files beside it, as they are asked for."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from cosim.errors import UsageError
from cosim.files import keep_inputs
from cosim.rig import EFFECTS, PARAMETERS, Noise, Recipe, RigRun, make
from cosim.rig.excitation import read_command
from cosim.rig.hidden import parse_setting
from cosim.rig.noise import SIZES, UNITS
from cosim.rig.parameters import nominal_value
from cosim.rig.write import check_suffix, write, write_markers, write_tracker, write_truth
from cosim.units import parse_quantity


@dataclass(frozen=True)
class Asked:
    """What is asked for; the attributes are those of `cosim.rig.Recipe`, numbers with units as texts."""

    excitation: str = "mixed"
    played: Path | None = None
    duration: str | None = None
    amplitude: float = 1.0
    seed: int = 1
    start: str | None = None
    hide: list[str] = field(default_factory=list)
    settings: list[str] = field(default_factory=list)
    model: str = "full_order"
    friction: str = "sharp"
    noise: float = 1.0
    noise_kind: str = "white"
    noise_time: str = "10 ms"
    noise_size: list[str] = field(default_factory=list)
    observer: bool = False
    card: bool = False

    def recipe(self, tracker: bool, markers: bool) -> Recipe:
        """The recipe of the log.

        Raises:
            UsageError: a text is no number of the right dimension, or a name is unknown.
        """
        return Recipe(
            self.excitation,
            _length(self.duration, self.excitation, self.played),
            self.hide,
            dict(parse_setting(text) for text in self.settings),
            _noise(self.noise, self.noise_kind, self.noise_time, self.noise_size),
            seed=self.seed,
            amplitude=self.amplitude,
            start=None if self.start is None else parse_quantity(self.start, "rad"),
            friction=self.friction,
            model=self.model,
            observer=self.observer,
            tracker=tracker,
            command_file=self.played,
            markers=markers,
            card=self.card,
        )


def make_files(
    asked: Asked, out: Path, tracker: Path | None = None, markers: Path | None = None
) -> tuple[RigRun, Path, Path | None]:
    """Make the log and write its files, after a check that they can be written.

    Args:
        asked: the log.
        out: its file.
        tracker: file of the tracker's record.
        markers: file of the marker positions.

    Returns:
        The run, the file of the truth, and that of the marker models.

    Raises:
        UsageError: a file cannot be written, or two would be one; or as `Asked.recipe`.
    """
    recipe = asked.recipe(tracker is not None, markers is not None)
    for path in filter(None, (out, tracker, markers)):
        check_suffix(path)
    if tracker is not None and tracker.resolve() == out.resolve():
        raise UsageError(f"log and tracker record would both be written to {out}: give two names")
    if markers is not None and markers.resolve() in [p.resolve() for p in (out, tracker) if p is not None]:
        raise UsageError(f"the marker positions would be written over {markers}: give another name")
    targets = [path for path in (out, tracker, markers) if path is not None]
    keep_inputs(targets, [recipe.command_file] if recipe.command_file is not None else [])
    run = make(recipe)
    write(run, out)
    if tracker is not None:
        write_tracker(run, tracker)
    models = None if markers is None else write_markers(run, markers)
    return run, write_truth(run, out), models


def effects_listed() -> list[dict[str, Any]]:
    """Every parameter of every effect: off value, moderate size, range, meaning; in SI units."""
    rows = []
    for effect, item in EFFECTS.items():
        for name, moderate in item.moderate.items():
            unit, low, high = PARAMETERS[name].unit, PARAMETERS[name].low, PARAMETERS[name].high
            rows.append({"effect": effect, "parameter": name.split(".")[1], "unit": unit, "off": nominal_value(name),
                         "moderate": moderate, "low": low, "high": high, "meaning": PARAMETERS[name].text})  # fmt: skip
    return rows


def _length(text: str | None, excitation: str, played: Path | None) -> float:
    """Duration [s]: as told, else a played file's own length, else a minute."""
    if text is not None:
        return parse_quantity(text, "s")
    if excitation != "file" or played is None:
        return 60.0
    stamps, _ = read_command(played)
    return max(2, round(float(stamps[-1]) / 1e-3)) * 1e-3


def _noise(scale: float, kind: str, time: str, sizes: list[str]) -> Noise:
    """The noise the texts describe."""
    chosen = {}
    for text in sizes:
        signal, equals, quantity = text.partition("=")
        if not equals or signal.strip() not in SIZES:
            raise UsageError(
                f"--noise-size '{text}' should read signal=size, with a signal of {', '.join(SIZES)}"
            )
        chosen[signal.strip()] = parse_quantity(quantity, UNITS[signal.strip()])
    return Noise(scale, kind, parse_quantity(time, "s"), chosen)
