"""Join a block's equations and its effects' terms into one module text.

The text is plain Python over `math` and named tuples. It is what an FMU runs, what numba compiles and what a C export
translates, so an equation is written once, in the block's or the effect's file. An effect at its off value is skipped by
a comparison, so the block then computes bit for bit what it computes without the effect.
"""

import ast
import hashlib
import inspect
import linecache
import textwrap
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from functools import cached_property, lru_cache
from types import ModuleType
from typing import Any

from fmus.contract import Block, Buffer, Effect, Variable
from fmus.syntax import parsed


@dataclass(frozen=True)
class Composed:
    """A block with effects: one module text and its variables.

    Attributes:
        block: the block.
        effects: the effects woven in, in order.
        source: text of the module; it defines Input, Output, State, Memory, Parameters, Coefficients, start, begin,
            coefficients, advance and output.
    """

    block: Block
    effects: tuple[Effect, ...]
    source: str

    @property
    def inputs(self) -> dict[str, Variable]:
        """Input variables, the communication time left out."""
        return {n: v for n, v in self.block.inputs.items() if v.kind != "time"}

    @property
    def outputs(self) -> dict[str, Variable]:
        """Output variables."""
        return self.block.outputs

    @property
    def parameters(self) -> dict[str, Variable]:
        """Parameters of the block and of its effects."""
        return merged_parameters(self.block, self.effects)

    @property
    def memory(self) -> dict[str, Variable | Buffer]:
        """What block and effects remember besides the state."""
        return merged_memory(self.block, self.effects)

    @cached_property
    def takes_time(self) -> bool:
        """True if the block's last input is the communication time."""
        return any(v.kind == "time" for v in self.block.inputs.values())

    @property
    def direct(self) -> tuple[str, ...]:
        """Outputs that follow an input at once, by a step of length 0; none where such a step needs the time or changes a list."""
        if self.takes_time or any(isinstance(item, Buffer) for item in self.memory.values()):
            return ()
        return tuple(name for name in self.outputs if self.block.feedthrough.get(name))

    @property
    def digest(self) -> str:
        """Twelve hexadecimal digits of the text's SHA-256."""
        return hashlib.sha256(self.source.encode()).hexdigest()[:12]

    @cached_property
    def module(self) -> ModuleType:
        """The text as a module of this process, for use from Python."""
        name = f"composed_{self.block.name}_{self.digest}"
        module = ModuleType(name, self.source.partition("\n")[0])
        linecache.cache[name] = (len(self.source), None, self.source.splitlines(keepends=True), name)
        exec(compile(self.source, name, "exec"), module.__dict__)
        return module


@dataclass(frozen=True)
class Known:
    """A composed block, equal to any other that is known by the same: what follows from that alone is found once.

    Attributes:
        by: its text, and names that are asked for beside it.
        composed: the block.
    """

    by: tuple[object, ...]
    composed: Composed = field(compare=False)


def merged_parameters(block: Block, effects: Iterable[Effect]) -> dict[str, Variable]:
    """Parameters of the block, then those that each effect adds; a parameter shared by two effects comes once."""
    merged = dict(block.parameters)
    for effect in effects:
        for name, variable in effect.parameters.items():
            if merged.setdefault(name, variable) != variable:
                raise ValueError(f"effect {effect.name}: parameter '{name}' exists with another declaration")
    return merged


def merged_memory(block: Block, effects: Iterable[Effect]) -> dict[str, Variable | Buffer]:
    """Arrays of the block, then what each effect remembers."""
    merged: dict[str, Variable | Buffer] = dict(block.memory)
    for effect in effects:
        for name, item in effect.memory.items():
            if name in merged:
                raise ValueError(f"effect {effect.name}: memory '{name}' exists already")
            merged[name] = item
    return merged


def compose(block: Block, effects: Iterable[Effect] = ()) -> Composed:
    """Weave `effects` into `block`.

    Raises:
        ValueError: an effect fills a slot that the block does not have, belongs to another block, or reuses a name.
    """
    woven = tuple(effects)
    for effect in woven:
        unknown = set(effect.fills) - set(block.slots)
        if unknown:
            raise ValueError(
                f"effect {effect.name} fills {sorted(unknown)}, which block '{block.name}' does not have; it has {sorted(block.slots)}"
            )
    parts = [header(block, woven)]
    known: dict[str, Callable[..., Any]] = {}
    extras = [f for e in woven for f in (*e.helpers, *e.fills.values(), e.begin, e.remember) if f is not None]
    for function in (*block.helpers, *extras, *block.equations):
        name = function.__name__
        if known.setdefault(name, function) is not function:
            raise ValueError(
                f"two equations are named '{name}' in block '{block.name}' with {[e.name for e in woven]}"
            )
    for function in known.values():
        filling = [e for e in woven if function.__name__ in e.fills] if function in block.equations else []
        parts.append(slot_text(function, filling) if filling else bare_text(function))
    parts += [begin_text(block, woven), advance_text(block, woven)]
    return Composed(block, woven, "\n\n".join(parts) + "\n")


def header(block: Block, effects: tuple[Effect, ...]) -> str:
    """Title, imports and the named tuples."""
    layouts = {
        "Input": list(block.inputs),
        "Output": list(block.outputs),
        "State": list(block.states),
        "Memory": list(merged_memory(block, effects)),
        "Parameters": list(merged_parameters(block, effects)),
        "Coefficients": list(block.module.Coefficients._fields),
    }
    title = f"{block.title}." + (f" Effects: {', '.join(e.name for e in effects)}." if effects else "")
    tuples = [f'{name} = namedtuple("{name}", {names!r})' for name, names in layouts.items()]
    return "\n".join([f'"""{title}"""', "import math", "from collections import namedtuple", "", *tuples])


@lru_cache(maxsize=1024)
def bare_text(function: Callable[..., Any], name: str | None = None) -> str:
    """Source of an equation without decorators and annotations, under another name if one is given."""
    tree = parsed(textwrap.dedent(inspect.getsource(function)))
    node = tree.body[0]
    assert isinstance(node, ast.FunctionDef)
    node.decorator_list = []
    node.returns = None
    node.name = name or node.name
    for argument in node.args.args:
        argument.annotation = None
    return ast.unparse(ast.fix_missing_locations(tree))


def is_on(effect: Effect, block: Block) -> str:
    """Condition text: the effect's key parameter is not at its off value."""
    off = effect.parameters[effect.key] if effect.key in effect.parameters else block.parameters[effect.key]
    return f"p.{effect.key} != {off.start!r}"


def slot_text(function: Callable[..., Any], effects: list[Effect]) -> str:
    """A slot with its effects: its own value first, then each effect's term added or each effect's replacement."""
    name = function.__name__
    arguments = list(inspect.signature(function).parameters)
    chain = function.__dict__["slot_rule"] == "chain"
    lines = [bare_text(function, f"{name}_alone"), "", f"def {name}({', '.join(arguments)}):"]
    lines.append(f"    value = {name}_alone({', '.join(arguments)})")
    block = inspect.getmodule(function).BLOCK  # type: ignore[union-attr]
    for effect in effects:
        call = effect.fills[name].__name__
        rest = ", ".join(["value", *arguments[1:]] if chain else arguments)
        lines.append(f"    if {is_on(effect, block)}:")
        lines.append(
            f"        value = {call}({rest})" if chain else f"        value = value + {call}({rest})"
        )
    return "\n".join([*lines, "    return value"])


def floats_of(effect: Effect) -> list[str]:
    """Names of the effect's memory that are plain numbers."""
    return [name for name, item in effect.memory.items() if isinstance(item, Variable)]


def begin_text(block: Block, effects: tuple[Effect, ...]) -> str:
    """``begin(x, u, p, buffers)``: memory at initialisation, `buffers` being the arrays in order of `Memory`."""
    memory = merged_memory(block, effects)
    lines = ["def begin(x, u, p, buffers):"]
    for effect in effects:
        names = floats_of(effect)
        if names:
            assert effect.begin is not None, f"effect {effect.name} remembers {names} but has no `begin`"
            lines.append(f"    {', '.join(names)}, = {effect.begin.__name__}(x, u, p)")
    arrays = [name for name, item in memory.items() if isinstance(item, Buffer)]
    values = [f"buffers[{arrays.index(name)}]" if name in arrays else name for name in memory]
    return "\n".join([*lines, f"    return Memory({', '.join(values)})"])


def advance_text(block: Block, effects: tuple[Effect, ...]) -> str:
    """``advance(x, m, u, p, c) -> (x, m)``: memory before the step, the step, memory after it."""
    lines = ["def advance(x, m, u, p, c):"]
    lines += remember_lines(block, [e for e in effects if e.remember and e.when == "before"], "x", effects)
    lines.append("    x1 = step(x, u, m, p, c)")
    lines += remember_lines(block, [e for e in effects if e.remember and e.when == "after"], "x1", effects)
    return "\n".join([*lines, "    return x1, m"])


def remember_lines(block: Block, active: list[Effect], x1: str, effects: tuple[Effect, ...]) -> list[str]:
    """Lines that update the memory of `active`, one effect at a time so that a later one sees the earlier one's."""
    lines = []
    for effect in active:
        assert effect.remember is not None
        names = floats_of(effect)
        call = f"{effect.remember.__name__}(x, {x1}, u, m, p, c)"
        lines.append(f"    if {is_on(effect, block)}:")
        if not names:
            lines.append(f"        {call}")
            continue
        values = [n if n in names else f"m.{n}" for n in merged_memory(block, effects)]
        lines += [f"        {', '.join(names)}, = {call}", f"        m = Memory({', '.join(values)})"]
    return lines
