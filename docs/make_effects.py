"""Writes the table of docs/effects.md from the registry: ``python docs/make_effects.py``."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

from fmus import registry
from fmus.contract import Effect, Variable

FILE = Path(__file__).resolve().parent / "effects.md"
BEGIN, END = "<!-- table: python docs/make_effects.py -->", "<!-- end of table -->"


def declared(effect: Effect, name: str) -> Variable:
    """Declaration of a parameter that the effect frees: its own, or its block's."""
    if name in effect.parameters:
        return effect.parameters[name]
    return registry.parameter(effect.component, name)


def parameters(effect: Effect) -> str:
    """Freed parameters with unit and off value, those of other forms of the law last."""
    rows = []
    for name in (*effect.free, *effect.forms):
        if effect.component == "tracker" and name not in effect.parameters:
            continue
        variable = declared(effect, name)
        form = "; another form: " if name in effect.forms else ""
        rows.append(f"{form}`{effect.component}.{name}` ({variable.start:g}) {variable.unit}")
    for block in effect.on:
        there = registry.effect_on(effect.name, block)
        if there is not None and there.free != effect.free:
            own = [(n, registry.block(block).parameters[n]) for n in there.free]
            names = ", ".join(f"`{effect.component}.{n}` ({v.start:.3g}) {v.unit}" for n, v in own)
            rows.append(f"; in {block}: {names}")
    return ", ".join(rows).replace(", ; ", "; ")


def table() -> str:
    """The table of all effects, those of installed packages included."""
    lines = [
        "| effect | what happens | parameters (off value), SI | what its residual looks like |",
        "|---|---|---|---|",
    ]
    for effect in registry.effects().values():
        asked = " Considered on request only." if effect.asked else ""
        if effect.alone:
            asked = " On request only where its block is not judged by itself."
        if effect.only:
            asked = f" In {effect.only} alone."
        lines.append(f"| `{effect.name}` | {effect.text}{asked} | {parameters(effect)} | {effect.residual} |")
    return "\n".join(lines)


def written(text: str) -> str:
    """The page with the table between its marks renewed."""
    head, _, rest = text.partition(BEGIN)
    _, _, tail = rest.partition(END)
    return f"{head}{BEGIN}\n{table()}\n{END}{tail}"


if __name__ == "__main__":
    FILE.write_text(written(FILE.read_text(encoding="utf-8")), encoding="utf-8")
