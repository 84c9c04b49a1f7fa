"""Makes docs/gallery.md and its pictures, a diagnosis for each effect of the library: ``python docs/make_gallery.py``.

Every log is synthetic: the virtual rig hides one effect of moderate size in 30 s at 1 kHz. Each is diagnosed by
`cosim.diagnose`, packages and runs of the FMUs included; the answers stay in build/gallery, so that a run that was ended
goes on where it was, and one effect can be made anew by its name. All of them take some ten minutes.
"""

import argparse
import math
import shutil
import sys
import time
from pathlib import Path
from typing import Any

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from PIL import Image

import cosim
from cosim.diagnosis.answer.schema import Answer
from cosim.diagnosis.fitting.trials import declared
from cosim.lexicon import speaking
from cosim.report.evidence import pictures
from cosim.report.folder import ANSWER, lexicon_of, load, read_answer
from cosim.report.picture import COLOURS, DASHES, Layer, Picture
from cosim.report.plain import three_sentences
from cosim.report.words import NAMES, number, unit_text
from cosim.rig import EFFECTS, Hidden, as_log, as_tracker, make_log
from cosim.units import factor
from fmus import registry

TOP = Path(__file__).resolve().parents[1]
PAGE = TOP / "docs" / "gallery.md"
IMAGES = TOP / "docs" / "images" / "gallery"
RESULTS = TOP / "build" / "gallery"
EXCITATION, DURATION, SEED = "mixed", 30.0, 3
TRACKED = ("tracker.", "sensor.bias", "sensor.gain", "sensor.drift")  # nothing else shows these
WIDE, HIGH, DPI = 6.4, 2.6, 100  # inches, dots an inch
POINTS = 400  # of a layer that is scattered: more cannot be told apart at this size
LINES = {"solid": "-", "dash": "--", "dot": ":"}  # of the report -> of matplotlib
HEAD = """# Gallery: one diagnosis for each effect

<!-- made by: python docs/make_gallery.py -->

Every log here is **synthetic**: the virtual rig hides one effect of moderate size in {duration:g} s of `{excitation}`
excitation at 1 kHz, with the sensors' noise ([rig.md](rig.md)). Each was diagnosed as `cosim diagnose` does it, with nothing
said about what is hidden. Below each name: what was hidden, what was found with its 95 % interval, the sentences of the
report, and the picture of the evidence, in which red is the model without the cause and blue with it.

In {right} of {made} the hidden effect is the first cause named{alike}. This is one log of each, of a size that shows.
How often it is right over many sizes and seeds, and where it fails, is in [scores.md](scores.md);
[effects.md](effects.md) says what each residual looks like.

`python docs/make_gallery.py` makes this page and its pictures anew; `python docs/make_gallery.py dcv.delay` one of them.
"""


# rad: a log that begins where the sensor has ended does not tell where the machine stands
STARTS = {"sensor.saturation": math.radians(14.0)}


def tracked(effect: str) -> bool:
    """Whether the log comes with the tracker's record."""
    return effect.startswith(TRACKED)


def diagnose(effect: str, folder: Path) -> None:
    """Hide an effect, and leave the diagnosis in a folder."""
    run = make_log(
        EXCITATION, DURATION, [Hidden(effect)], seed=SEED, tracker=tracked(effect), start=STARTS.get(effect)
    )
    shutil.rmtree(folder, ignore_errors=True)
    cosim.diagnose(as_log(run), external=as_tracker(run) if tracked(effect) else None, out=folder)


def drawn(picture: Picture) -> Figure:
    """A picture of the report by matplotlib."""
    rows = len(picture.panels)
    figure = Figure(figsize=(WIDE, HIGH + 1.1 * (rows - 1)), dpi=DPI, layout="constrained")
    grid = figure.subplots(rows, 1, sharex=True, squeeze=False)
    for axes, panel in zip(grid[:, 0], picture.panels, strict=True):
        for layer in panel.layers:
            if not layer.hidden:
                _draw(axes, layer, picture)
        axes.set_ylabel(panel.y, fontsize=8)
        axes.set_xscale("log" if picture.log else "linear")
        axes.set_yscale("log" if panel.log else "linear")
        axes.tick_params(labelsize=8)
        axes.grid(color="#e5e7eb", linewidth=0.6)
        axes.spines[["top", "right"]].set_visible(False)
    grid[-1, 0].set_xlabel(picture.x, fontsize=8)
    grid[0, 0].legend(fontsize=7, frameon=False, ncols=3, loc="lower left", bbox_to_anchor=(0.0, 1.0))
    return figure


def _draw(axes: Any, layer: Layer, picture: Picture) -> None:
    colour, name = COLOURS[layer.role], layer.name or None
    few = slice(None, None, max(1, layer.x.size // POINTS))
    if layer.kind == "line":
        style = LINES[DASHES.get(layer.role, "solid")]
        axes.plot(layer.x, layer.y, style, color=colour, linewidth=1.0, label=name)
    elif layer.kind == "points":
        axes.plot(layer.x[few], layer.y[few], ".", color=colour, markersize=2, alpha=0.35, label=name)
    elif layer.kind == "means":
        style = {"markersize": 4, "linewidth": 1.0, "markeredgecolor": "white", "markeredgewidth": 0.5}
        axes.errorbar(layer.x, layer.y, layer.error, fmt="o", color=colour, label=name, **style)
    elif layer.kind == "bars":
        axes.bar(picture.labels or layer.x, layer.y, color=colour, label=name)
    elif layer.error is not None:
        axes.fill_between(layer.x, layer.y, layer.error, color=colour, alpha=0.4, linewidth=0, label=name)


def palette() -> Image.Image:
    """The colours of the report and their blends with white, so that none of them is lost in a small file."""
    colours = [*(to_rgb(colour) for colour in COLOURS.values()), (0.0, 0.0, 0.0)]
    shades = [1.0 - k / 6.0 * (1.0 - part) for colour in colours for k in range(7) for part in colour]
    found = Image.new("P", (1, 1))
    found.putpalette([round(255 * x) for x in shades])
    return found


def save(figure: Figure, path: Path) -> None:
    """A small picture: few colours, without loss, nothing about when it was made."""
    path.parent.mkdir(parents=True, exist_ok=True)
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    with Image.fromarray(np.asarray(canvas.buffer_rgba())) as picture:
        few = picture.convert("RGB").quantize(palette=palette(), dither=Image.Dither.NONE)
        few.convert("RGB").save(path, lossless=True, quality=100, method=6)


def hidden_sizes(effect: str) -> str:
    """What was hidden, in the units people read."""
    found = []
    for name, value in Hidden(effect).numbers().items():
        short = name.partition(".")[2]
        variable = declared(registry.effects()[effect], short)
        unit = variable.display or variable.unit
        found.append(f"{short} = {value * factor(variable.unit, unit):.4g} {unit_text(unit)}".rstrip())
    return ", ".join(found)


def found_sizes(answer: Answer) -> str:
    """What was named, with intervals."""
    told = []
    for cause in answer.causes:
        sizes = []
        for name, item in cause.parameters.items():
            spread = 0.5 * (item.ci95[1] - item.ci95[0])
            low, high = (number(end, spread) for end in item.ci95)
            sizes.append(
                f"{name} = {number(item.value, spread)} ({low} to {high}) {unit_text(item.unit)}".rstrip()
            )
        told.append(f"`{cause.effect}`: {', '.join(sizes)}")
    return "; ".join(told) or "nothing"


def entry(effect: str, folder: Path) -> str:
    """The part of the page about one effect; its picture is written."""
    material = load(folder)
    answer = material.answer
    with speaking(lexicon_of(answer)):
        said = " ".join(text for _, text in three_sentences(material))
        image, caption = "", ""
        if answer.causes:
            picture = pictures(material, answer.causes[0])[0]
            save(drawn(picture), IMAGES / f"{effect}.webp")
            image, caption = (
                f"![{picture.title}](images/gallery/{effect}.webp)\n\n",
                f"*{picture.caption}*\n\n",
            )
    also = " The log comes with the tracker's record." if tracked(effect) else ""
    return (
        f"## {NAMES[effect][0].upper()}{NAMES[effect][1:]} (`{effect}`)\n\n"
        f"{registry.effects()[effect].text}{also}\n\n"
        f"| hidden | found |\n|---|---|\n| {hidden_sizes(effect)} | {found_sizes(answer)} |\n\n"
        f"> {said}\n\n{image}{caption}"
    )


def outcome(effect: str, answer: Answer) -> str:
    """How the hidden effect stands in the answer: right, alike or wrong."""
    if not answer.causes:
        return "wrong"
    first = answer.causes[0]
    return (
        "right" if first.effect == effect else "alike" if effect in first.indistinguishable_from else "wrong"
    )


def page(effects: list[str]) -> str:
    """The page, of all effects of which there is a diagnosis."""
    made = [e for e in effects if (RESULTS / e / ANSWER).is_file()]
    outcomes = [outcome(e, read_answer(RESULTS / e)) for e in made]
    right, same = outcomes.count("right"), outcomes.count("alike")
    alike = f"; in {same} more this log cannot tell it from the one named" if same else ""
    head = HEAD.format(duration=DURATION, excitation=EXCITATION, made=len(made), right=right, alike=alike)
    others = [e for e in registry.effects() if e not in EFFECTS]
    rest = (
        "## Effects without a synthetic log\n\nThe rig cannot hide these, or by `--set` alone (`--model physical`); "
        "their tests make logs of their own: "
    )
    names = ", ".join(f"{NAMES[e]} (`{e}`)" for e in others)
    parts = [head, *(entry(e, RESULTS / e) for e in made), f"{rest}{names}."]
    return "\n".join(part.strip() + "\n" for part in parts)


def main() -> None:
    """Make what is asked for, and the page of all that is there."""
    parser = argparse.ArgumentParser(description=__doc__)
    effects = [name for name in registry.effects() if name in EFFECTS]
    parser.add_argument(
        "effects", nargs="*", metavar="EFFECT", help="make these anew [default: all that are missing]"
    )
    asked = parser.parse_args().effects
    for name in asked:
        if name not in effects:
            parser.error(f"no effect '{name}' that the rig can hide: one of {', '.join(effects)}")
    for name in asked or [e for e in effects if not (RESULTS / e / ANSWER).is_file()]:
        began = time.process_time()
        diagnose(name, RESULTS / name)
        answer = read_answer(RESULTS / name)
        causes = ", ".join(cause.effect for cause in answer.causes)
        print(
            f"{name}: {answer.verdict}, {causes or 'no cause'} ({time.process_time() - began:.0f} s)",
            flush=True,
        )
    PAGE.write_text(page(effects), encoding="utf-8")
    small = sum(file.stat().st_size for file in IMAGES.glob("*.webp"))
    print(f"{PAGE.relative_to(TOP)} and {small / 1024:.0f} KiB of pictures")


if __name__ == "__main__":
    main()
