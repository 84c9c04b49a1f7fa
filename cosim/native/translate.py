"""Translate the composed text of a block to C99.

The text is plain Python over `math` and named tuples (`fmus/compose.py`). Each function becomes one static C function for
the kinds of arguments it is called with; named tuples become structs handed on by address; what may raise an exception in
Python sets a fault instead (`c/semantics.h`). Every arithmetic operation stays, in its order, so that the numbers are the
same (tests/native/test_native_twin.py). What cannot be translated is refused with the name of the function and its line.
"""

import ast
import re
from collections.abc import Mapping, Sequence
from functools import lru_cache

from cosim.errors import ModelError
from cosim.native.expressions import FAILING, SAFE, TESTS, RefusedError
from cosim.native.function import Function
from cosim.native.kinds import ARRAY, ARRAYS, REAL, Kind, Struct, c_name
from fmus.compose import Composed, Known
from fmus.contract import Buffer
from fmus.syntax import parsed

LAYOUTS = ("Input", "Output", "State", "Memory", "Parameters", "Coefficients")
# what the outside calls, with the arguments of each: named tuples, numbers, and the lists that are remembered
CO_SIMULATION: dict[str, tuple[str | Kind, ...]] = {
    "start": ("Input", "Parameters"),
    "begin": ("State", "Input", "Parameters", ARRAYS),
    "coefficients": ("Parameters", REAL),
    "advance": ("State", "Memory", "Input", "Parameters", "Coefficients"),
    "output": ("State", "Input", "Memory", "Parameters"),
}


class Program:
    """The C text of one composed block.

    Attributes:
        prefix: begins the names of its types and functions, so that several blocks can share a file.
        with_rates: every number carries a derivative.
        layouts: the named tuples as structs.
        entries: the functions that the outside calls, by name.
    """

    def __init__(
        self,
        composed: Composed,
        prefix: str,
        called: Mapping[str, tuple[str | Kind, ...]] = CO_SIMULATION,
        with_rates: bool = False,
    ) -> None:
        """Translate a block, as far as what is `called` needs it.

        Raises:
            ModelError: an equation of the block or of one of its effects has no translation.
        """
        self.composed, self.prefix, self.with_rates = composed, prefix, with_rates
        tree = parsed(composed.source)
        self.nodes = {node.name: node for node in tree.body if isinstance(node, ast.FunctionDef)}
        self.layouts = {name: self.layout(name) for name in LAYOUTS}
        self.plain: dict[tuple[Kind, ...], Struct] = {}
        self.done: dict[tuple[str, tuple[Kind, ...]], Function] = {}
        self.open: list[str] = []
        self.entries = {
            name: self.translated(name, [self.layouts[k] if isinstance(k, str) else k for k in kinds])
            for name, kinds in called.items()
        }

    def layout(self, name: str) -> Struct:
        """A named tuple as a struct: numbers, but for the lists that are remembered."""
        lists = (
            {n for n, item in self.composed.memory.items() if isinstance(item, Buffer)}
            if name == "Memory"
            else set()
        )
        fields = getattr(self.composed.module, name)._fields
        return Struct(f"{self.prefix}{name}", name, tuple((f, ARRAY if f in lists else REAL) for f in fields))

    def tuples(self, kinds: tuple[Kind, ...]) -> Struct:
        """The struct of a plain tuple."""
        if kinds not in self.plain:
            fields = tuple((f"e{k}", kind) for k, kind in enumerate(kinds))
            name = f"{self.prefix}tuple{len(self.plain) + 1}"
            self.plain[kinds] = Struct(name, f"a tuple of {len(kinds)}", fields)
        return self.plain[kinds]

    def translated(self, name: str, kinds: Sequence[Kind]) -> Function:
        """A function of the text for arguments of these kinds.

        Raises:
            ModelError: it has no translation.
        """
        key = name, tuple(kinds)
        if key in self.done:
            return self.done[key]
        effects = ", ".join(e.name for e in self.composed.effects)
        where = f"block '{self.composed.block.name}' with {effects or 'no effects'}"
        if name not in self.nodes:
            raise RefusedError(f"there is no function '{name}'")
        if name in self.open:
            raise ModelError(f"{where} cannot be translated to C: {name} calls itself")
        self.open.append(name)
        same = sum(1 for other, _ in self.done if other == name)
        c = f"{self.prefix}{c_name(name)}{f'_{same + 1}' if same else ''}"
        try:
            found = Function(
                self.nodes[name], kinds, c, self.layouts, self.tuples, self.translated, self.with_rates
            )
        except RefusedError as error:
            raise ModelError(f"{where} cannot be translated to C: function {name}: {error}") from None
        self.open.pop()
        self.done[key] = found
        return found

    def call(self, name: str, result: str, *arguments: str) -> str:
        """A statement that calls an entry: addresses of structs and other arguments, all that Python gives it."""
        entry = self.entries[name]
        texts = [a for k, a in enumerate(arguments) if not entry.leaves_out(k)]
        return f"{result} = {entry.name}({', '.join([*texts, *(['py_fault'] if entry.fails else [])])});"

    def text(self) -> str:
        """Structs, then functions, each before its callers."""
        title = ast.get_docstring(parsed(self.composed.source)) or self.composed.block.title
        comment = f"/* {title.replace('*/', '* /')} */"
        structs = [s.definition() for s in (*self.layouts.values(), *self.plain.values())]
        text = "\n\n".join([comment, *structs, *(f.text() for f in self.done.values())]) + "\n"
        return rated(text) if self.with_rates else text


@lru_cache(maxsize=256)
def _translated(
    block: Known, prefix: str, called: tuple[tuple[str, tuple[str | Kind, ...]], ...], with_rates: bool
) -> Program:
    return Program(block.composed, prefix, dict(called), with_rates)


def program_of(
    composed: Composed,
    prefix: str,
    called: Mapping[str, tuple[str | Kind, ...]] = CO_SIMULATION,
    with_rates: bool = False,
) -> Program:
    """The program of a block, translated once a process: FMUs of several packages and versions hold the same text.

    Raises:
        ModelError: an equation of the block or of one of its effects has no translation.
    """
    lists = tuple(n for n, item in composed.memory.items() if isinstance(item, Buffer))
    known = Known((composed.source, composed.block.title, lists), composed)
    return _translated(known, prefix, tuple(called.items()), with_rates)


LITERAL = re.compile(r"(?<![\w.)])-?(?:\d+\.\d+(?:e[-+]?\d+)?|\d+e[-+]?\d+|HUGE_VAL|NAN)\b")


def rated(text: str) -> str:
    """C text of numbers as that of numbers with a derivative: another type, other helpers, literals without a derivative."""
    comment, end, text = text.partition("*/")
    helpers = "|".join(
        (*FAILING, "divide", "modulo", "floor_divide", "power", "min", "max", "round", "whole", "get", "set")
    )
    text = re.sub(rf"\bpy_({helpers})\(", r"pc_\1(", text)
    text = re.sub(rf"\b({'|'.join((*SAFE, *TESTS))})\(", r"pc_\1(", text)
    text = LITERAL.sub(r"pc_real(\g<0>)", text.replace("(double)(", "pc_real("))
    return comment + end + re.sub(r"\bdouble\b", "py_dual", text)
