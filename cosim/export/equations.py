"""Translate the composed equations of a block to Modelica functions.

The same text that the FMUs run (`fmus/compose.py`) becomes records and functions with algorithms; every arithmetic operation
stays, in its order. Which kind of value a variable has is known from the translation to C (`cosim/native`).
What Modelica has no word for goes by way of the package's `Internal`: `expm1`, `log1p`, `copysign` and `truncated`.
"""

import ast
import math
from collections.abc import Callable, Sequence
from typing import NamedTuple

from cosim.errors import ModelError
from cosim.export.names import MODELICA_KEYWORDS, identifier
from cosim.export.render import modelica_text, one_line
from cosim.native.expressions import CONSTANTS
from cosim.native.function import Function
from cosim.native.kinds import ARRAY, ARRAYS, NONE, NUMBERS, REAL, TRUTH, WHOLE, Kind, Struct, joined
from cosim.native.translate import Program
from fmus.contract import Buffer
from fmus.syntax import parsed

BUILT_IN = frozenset((
    "abs", "acos", "acosh", "activeState", "actualStream", "asin", "atan", "atan2", "backSample", "cardinality",
    "cat", "ceil", "change", "cos", "cosh", "cross", "delay", "diagonal", "div", "edge", "exp", "fill", "floor",
    "getInstanceName", "hold", "homotopy", "identity", "initial", "inStream", "integer", "interval", "linspace", "log",
    "log10", "matrix", "max", "min",
    "mod", "ndims", "noClock", "noEvent", "ones", "outerProduct", "pre", "previous", "product", "promote", "reinit", "rem",
    "rooted", "sample", "scalar", "semiLinear", "shiftSample", "sign", "sin", "sinh", "size", "skew", "smooth",
    "spatialDistribution", "sqrt", "String", "subSample", "sum", "superSample", "symmetric", "tan", "tanh", "terminal",
    "terminate", "ticksInState", "time", "timeInState", "transition", "transpose", "vector", "zeros", "Real", "Integer",
    "Boolean", "Internal", "initialState", "step", "begin",
))  # fmt: skip
TYPES = {REAL: "Real", WHOLE: "Integer", TRUTH: "Boolean"}
PLAIN = (
    "sin", "cos", "tan", "asin", "acos", "atan", "atan2", "sinh", "cosh", "tanh", "exp", "log", "log10", "sqrt", "floor",
    "ceil",
)  # fmt: skip
OURS = ("expm1", "log1p", "copysign")

# how tightly an expression binds in Modelica's grammar, where a sign may stand at the front of a sum alone
ATOM, POWER, PRODUCT, SUM, RELATION, NOT, AND, OR, CHOICE = 9, 8, 7, 6, 5, 4, 3, 2, 1
OPERATORS: dict[type[ast.operator], tuple[str, int]] = {
    ast.Add: ("+", SUM), ast.Sub: ("-", SUM), ast.Mult: ("*", PRODUCT), ast.Div: ("/", PRODUCT), ast.Pow: ("^", POWER),
}  # fmt: skip
RELATIONS: dict[type[ast.cmpop], str] = {
    ast.Lt: "<", ast.LtE: "<=", ast.Gt: ">", ast.GtE: ">=", ast.Eq: "==", ast.NotEq: "<>",
}  # fmt: skip


class _UnknownError(Exception):
    """No Modelica for a piece of Python; the text says what."""


class Text(NamedTuple):
    """Modelica text of an expression, what it gives, and how tightly it binds; `signed`: it begins with a sign."""

    code: str
    kind: Kind
    rank: int = ATOM
    signed: bool = False

    def at(self, rank: int) -> str:
        """The text, in parentheses if it binds less tightly than `rank`."""
        return self.code if self.rank >= rank else f"({self.code})"

    def inner(self, rank: int) -> str:
        """As `at`, for what has an operator before it."""
        return f"({self.code})" if self.signed else self.at(rank)


def name_of(name: str) -> str:
    """The name in Modelica: another one where a keyword or a built-in function has it."""
    text = identifier(name, MODELICA_KEYWORDS)
    return f"{text}_" if text in BUILT_IN else text


def real(value: float) -> str:
    """A number as Modelica reads it, with all its digits.

    Raises:
        _UnknownError: it is not finite.
    """
    if not math.isfinite(value):
        raise _UnknownError(f"the number {value}")
    return repr(value)


class Library:
    """The records and functions of one block, for a package that is a member of Equations.

    Attributes:
        program: the block's equations as the C export knows them.
        sizes: length of each list that block and effects remember.
        remembers: block or effects remember anything beside the state.
        entries: the functions that a model calls.
        texts: Modelica of each function, callees first.
    """

    def __init__(self, program: Program) -> None:
        """Translate what a model of the block calls, and all that this calls.

        Raises:
            ModelError: an equation has no Modelica; the message names block, function and line.
        """
        self.program = program
        self.sizes = {n: b.length for n, b in program.composed.memory.items() if isinstance(b, Buffer)}
        self.names: dict[str, str] = {}
        self.texts: dict[str, str] = {}
        self.changes: dict[str, str] = {}
        self.remembers = bool(program.composed.memory)
        u, _, x, m, p, c = program.layouts.values()
        self.entries = {n: program.entries[n] for n in ("coefficients", "start", "output")}
        if self.remembers:
            self.entries |= {n: program.entries[n] for n in ("begin", "advance")}
        else:
            self.entries["step"] = program.translated("step", (x, u, m, p, c))
        for function in self.entries.values():
            self.add(function)

    def call(self, entry: str, *arguments: str) -> str:
        """A call of an entry from outside, given all arguments that Python gives it."""
        function = self.entries[entry]
        texts = [a for k, a in enumerate(arguments) if a and not function.leaves_out(k)]
        return f"{self.names[function.name]}({', '.join(texts)})"

    def add(self, function: Function) -> str:
        """The name of a function's translation, made if there is none yet."""
        if function.name not in self.names:
            own = name_of(function.name.removeprefix(self.program.prefix))
            self.names[function.name] = own
            try:
                translation = _Translation(self, function)
            except _UnknownError as error:
                block = self.program.composed.block.name
                raise ModelError(
                    f"block '{block}' cannot be written in Modelica: function {function.node.name}: {error}"
                ) from None
            self.texts[function.name] = translation.text(own)
        return self.names[function.name]

    def records(self) -> list[str]:
        """Definitions of the named tuples that have fields."""
        return [self.record(s) for s in self.program.layouts.values() if s.fields]

    def record(self, struct: Struct) -> str:
        """One record; lists have the length that block or effect declares."""
        lines = [f"record {struct.text}"]
        lines += [
            f"  Real {name_of(n)}[{self.sizes[n]}];" if kind is ARRAY else f"  {TYPES[kind]} {name_of(n)};"
            for n, kind in struct.fields
        ]
        return "\n".join([*lines, f"end {struct.text};"])


class _Translation:
    """One function. The lists that it changes in place leave it as a further result, `changed`."""

    def __init__(self, library: Library, function: Function) -> None:
        self.library, self.function = library, function
        self.find = function.find
        self.lines: list[str] = []
        self.indent = "  "
        self.temporaries: list[str] = []
        self.iterators: list[str] = []
        self.changed = self.changing()
        if self.changed:
            library.changes[function.name] = self.changed
        self.results = self.result_types()
        self.block(without_continue(function.body))
        if self.lines and self.lines[-1] == "  return;":
            self.lines.pop()

    def type_of(self, kind: Kind) -> str:
        if isinstance(kind, Struct) and kind.text in self.library.program.layouts:
            return kind.text
        if kind not in TYPES:
            raise _UnknownError(f"{kind.text} as a variable")
        return TYPES[kind]

    def plain(self, kind: Kind) -> bool:
        """True for a plain tuple, which has no record."""
        return isinstance(kind, Struct) and kind.text not in self.library.program.layouts

    def result_types(self) -> list[tuple[str, str]]:
        """Outputs: name and type."""
        result = self.function.result
        if result is NONE:
            return []
        if self.plain(result):
            assert isinstance(result, Struct)
            return [(f"result{k}", self.type_of(kind)) for k, kind in enumerate(result.kinds, 1)]
        return [("result1", self.type_of(result))]

    def changing(self) -> str:
        """The parameter whose lists this function changes, or an empty text."""
        found = set()
        for node in (n for s in self.function.body for n in ast.walk(s)):
            if isinstance(node, ast.Subscript) and isinstance(node.ctx, ast.Store):
                whole = node.value
                if not (isinstance(whole, ast.Attribute) and isinstance(whole.value, ast.Name)):
                    raise _UnknownError(f"'{ast.unparse(node)}' as a target")
                found.add(whole.value.id)
        if self.function.node.name == "advance":  # what it hands back holds the lists
            return ""
        if len(found) > 1 or not found <= set(self.function.parameters):
            raise _UnknownError("lists of several variables that are changed")
        return next(iter(found), "")

    # The function

    def text(self, name: str) -> str:
        """Its definition."""
        function = self.function
        summary = one_line((ast.get_docstring(function.node) or "").partition("\n")[0])
        lines = [f"function {name}" + (f" {modelica_text(summary)}" if summary else "")]
        copies = []
        local = dict(function.kinds)
        for k, (own, kind) in enumerate(function.parameters.items()):
            if function.leaves_out(k):
                local.pop(own)
                continue
            if function.stores[own] > 0 or own == self.changed:
                lines.append(f"  input {self.type_of(kind)} given_{name_of(own)};")
                copies.append(f"  {name_of(own)} := given_{name_of(own)};")
            elif kind is ARRAYS:
                local.pop(own)
                lines += [f"  input Real {name_of(n)}[{size}];" for n, size in self.library.sizes.items()]
            else:
                local.pop(own)
                lines.append(f"  input {self.type_of(kind)} {name_of(own)};")
        lines += [f"  output {kind} {result};" for result, kind in self.results]
        if self.changed:
            lines.append(f"  output {self.type_of(function.parameters[self.changed])} changed;")
        # what is assigned and never read has no place
        read = [
            n for n in local if n not in self.iterators and (n in function.loads or n in function.parameters)
        ]
        declared = [f"  {self.type_of(local[n])} {name_of(n)};" for n in read] + self.temporaries
        lines += ["protected", *declared] if declared else []
        body = copies + self.lines
        if self.changed:
            body.append(f"  changed := {name_of(self.changed)};")
        return "\n".join([*lines, "algorithm", *body, f"end {name};"])

    def line(self, text: str) -> None:
        self.lines.append(self.indent + text)

    def block(self, body: Sequence[ast.stmt]) -> None:
        for statement in body:
            method: Callable[[ast.stmt], None] | None = getattr(self, f"do_{type(statement).__name__}", None)
            text = ast.unparse(statement).partition("\n")[0]
            try:
                if method is None:
                    raise _UnknownError(type(statement).__name__)
                method(statement)
            except _UnknownError as error:
                if str(error).startswith("line "):
                    raise
                raise _UnknownError(f"line '{text}': there is no Modelica for {error}") from None

    def nested(self, body: Sequence[ast.stmt]) -> None:
        self.indent += "  "
        self.block(body)
        self.indent = self.indent[:-2]

    # Statements

    def do_Pass(self, node: ast.Pass) -> None:
        pass

    def do_Break(self, node: ast.Break) -> None:
        self.line("break;")

    def do_Expr(self, node: ast.Expr) -> None:
        if isinstance(node.value, ast.Call):
            self.call_into([], node.value)
        elif not isinstance(node.value, ast.Constant):
            raise _UnknownError("an expression that does nothing")

    def do_Assign(self, node: ast.Assign) -> None:
        self.store(node.targets[0], node.value)

    def do_AugAssign(self, node: ast.AugAssign) -> None:
        [target] = parsed(ast.unparse(node.target)).body
        assert isinstance(target, ast.Expr)
        self.store(node.target, ast.BinOp(target.value, node.op, node.value))

    def store(self, target: ast.expr, source: ast.expr) -> None:
        if isinstance(target, ast.Name):
            if self.is_plain_call(source):
                raise _UnknownError(f"'{target.id}', a plain tuple")
            if target.id in self.function.loads:
                self.assign(target.id, source)
        elif isinstance(target, ast.Subscript):
            self.line(f"{self.element(target)} := {self.number(source).code};")
        elif isinstance(target, ast.Tuple):
            self.unpack([e.id for e in target.elts if isinstance(e, ast.Name)], source)
        else:
            raise _UnknownError(f"'{ast.unparse(target)}' as a target")

    def assign(self, name: str, source: ast.expr) -> None:
        value = self.expression(source)
        if name in self.function.parameters and value.kind is ARRAY:
            raise _UnknownError(f"'{name}', a list")
        self.line(f"{name_of(name)} := {self.fitting(value, self.function.kinds[name])};")

    def is_plain_call(self, node: ast.expr) -> bool:
        return self.calls_ours(node) and self.plain(self.callee(node).result)

    def calls_ours(self, node: ast.expr) -> bool:
        return (
            isinstance(node, ast.Call)
            and isinstance(node.func, ast.Name)
            and node.func.id in self.library.program.nodes
        )

    def unpack(self, targets: list[str], source: ast.expr) -> None:
        wanted = [n if n in self.function.loads else "" for n in targets]
        if isinstance(source, ast.Tuple):
            read = {n.id for e in source.elts for n in ast.walk(e) if isinstance(n, ast.Name)}
            pairs = [(t, e) for t, e in zip(wanted, source.elts, strict=True) if t]
            if read & set(targets) and len(pairs) > 1:
                held = []
                for target, element in pairs:
                    kind = self.function.kinds[target]
                    held.append((target, self.temporary(kind, self.fitting(self.expression(element), kind))))
                for target, name in held:
                    self.line(f"{name_of(target)} := {name};")
                return
            for target, element in pairs:
                self.assign(target, element)
            return
        if self.calls_ours(source):
            assert isinstance(source, ast.Call)
            if self.plain(self.callee(source).result):
                self.call_into(wanted, source)
                return
        whole = self.expression(source)
        if not isinstance(whole.kind, Struct):
            raise _UnknownError(f"'{ast.unparse(source)}' to be unpacked")
        name = self.temporary(whole.kind, whole.code)
        for target, field in zip(wanted, whole.kind.names, strict=True):
            if target:
                self.line(f"{name_of(target)} := {name}.{name_of(field)};")

    def temporary(self, kind: Kind, code: str) -> str:
        """A further variable with a value."""
        name = f"held{len(self.temporaries) + 1}"
        self.temporaries.append(f"  {self.type_of(kind)} {name};")
        self.line(f"{name} := {code};")
        return name

    def call_into(self, targets: list[str], call: ast.Call) -> None:
        """A call of several results, or of one that changes a list."""
        callee = self.callee(call)
        code = self.call_text(callee, call)
        left = [name_of(t) if t else "" for t in targets]
        changed = self.library.changes.get(callee.name, "")
        if changed:
            given = call.args[list(callee.parameters).index(changed)]
            if not isinstance(given, ast.Name) or self.function.stores[given.id] == 0:
                raise _UnknownError(f"'{ast.unparse(given)}', whose lists a call changes")
            left.append(name_of(given.id))
        while left and not left[-1]:
            left.pop()
        if not left:
            raise _UnknownError("a call whose results nobody takes")
        self.line(
            f"{left[0]} := {code};" if len(left) == 1 and left[0] else f"({', '.join(left)}) := {code};"
        )

    def do_Return(self, node: ast.Return) -> None:
        assert node.value is not None
        value, result = node.value, self.function.result
        if not self.plain(result):
            self.line(f"result1 := {self.fitting(self.expression(value), result)};")
        elif isinstance(value, ast.Tuple):
            assert isinstance(result, Struct)
            for (name, _), kind, element in zip(self.results, result.kinds, value.elts, strict=True):
                self.line(f"{name} := {self.fitting(self.expression(element), kind)};")
        elif self.calls_ours(value):
            assert isinstance(value, ast.Call)
            names = [n for n, _ in self.results]
            self.line(f"({', '.join(names)}) := {self.call_text(self.callee(value), value)};")
        else:
            raise _UnknownError(f"'{ast.unparse(value)}' as several results")
        if self.changed and self.indent != "  ":
            self.line(f"changed := {name_of(self.changed)};")
        self.line("return;")

    def do_If(self, node: ast.If, head: str = "if") -> None:
        self.line(f"{head} {self.truth(node.test).code} then")
        self.nested(node.body)
        if len(node.orelse) == 1 and isinstance(node.orelse[0], ast.If):
            self.do_If(node.orelse[0], "elseif")
            return
        if node.orelse:
            self.line("else")
            self.nested(node.orelse)
        self.line("end if;")

    def do_While(self, node: ast.While) -> None:
        self.line(f"while {self.truth(node.test).code} loop")
        self.nested(without_continue(node.body))
        self.line("end while;")

    def do_For(self, node: ast.For) -> None:
        assert isinstance(node.iter, ast.Call)
        assert isinstance(node.target, ast.Name)
        bounds = [self.number(a) for a in node.iter.args]
        first = bounds[0].at(SUM) if len(bounds) == 2 else "0"
        name = node.target.id
        if name in self.function.loads:
            loops = [n for s in self.function.body for n in ast.walk(s) if isinstance(n, ast.For)]
            own = [n for n in loops if isinstance(n.target, ast.Name) and n.target.id == name]
            within = {id(n) for loop in own for s in loop.body for n in ast.walk(s)}
            for n in (n for s in self.function.body for n in ast.walk(s)):
                if isinstance(n, ast.Name) and n.id == name:
                    if isinstance(n.ctx, ast.Load) and id(n) not in within:
                        raise _UnknownError(f"'{name}' outside of its loop")
                    if isinstance(n.ctx, ast.Store) and not any(n is loop.target for loop in own):
                        raise _UnknownError(f"'{name}', which counts a loop, as a target")
        self.iterators.append(name)
        last = node.iter.args[-1]
        stop = (
            str(last.value - 1)
            if isinstance(last, ast.Constant) and isinstance(last.value, int)
            else f"{bounds[-1].at(SUM)} - 1"
        )
        shown = name_of(name) if name in self.function.loads else "k_"
        self.line(f"for {shown} in {first}:{stop} loop")
        self.nested(without_continue(node.body))
        self.line("end for;")

    # Expressions

    def expression(self, node: ast.expr) -> Text:
        method: Callable[[ast.expr], Text] | None = getattr(self, f"on_{type(node).__name__}", None)
        if method is None:
            raise _UnknownError(f"'{ast.unparse(node)}'")
        return method(node)

    def number(self, node: ast.expr) -> Text:
        value = self.expression(node)
        if value.kind not in NUMBERS:
            raise _UnknownError(f"'{ast.unparse(node)}' as a number")
        return Text(f"if {value.code} then 1 else 0", WHOLE, CHOICE) if value.kind is TRUTH else value

    def truth(self, node: ast.expr) -> Text:
        value = self.expression(node)
        return value if value.kind is TRUTH else Text(f"{self.number(node).at(SUM)} <> 0.0", TRUTH, RELATION)

    def fitting(self, value: Text, kind: Kind) -> str:
        """The text as a value of a wider kind; a whole number is a Real in Modelica where one is asked for."""
        if value.kind is TRUTH and kind is not TRUTH:
            return f"if {value.code} then 1 else 0"
        return value.code

    def on_Constant(self, node: ast.Constant) -> Text:
        if isinstance(node.value, bool):
            return Text("true" if node.value else "false", TRUTH)
        if isinstance(node.value, int):
            return Text(str(node.value), WHOLE)
        assert isinstance(node.value, float)
        return Text(real(node.value), REAL)

    def on_Name(self, node: ast.Name) -> Text:
        return Text(name_of(node.id), self.function.kinds[node.id])

    def on_Attribute(self, node: ast.Attribute) -> Text:
        if isinstance(node.value, ast.Name) and node.value.id == "math":
            return Text(real(CONSTANTS[node.attr]), REAL)
        whole = self.expression(node.value)
        assert isinstance(whole.kind, Struct)
        kind = whole.kind.kinds[whole.kind.names.index(node.attr)]
        return Text(f"{whole.code}.{name_of(node.attr)}", kind)

    def on_Subscript(self, node: ast.Subscript) -> Text:
        if isinstance(node.value, ast.Name) and self.function.kinds.get(node.value.id) is ARRAYS:
            assert isinstance(node.slice, ast.Constant)
            assert isinstance(node.slice.value, int)
            return Text(name_of(list(self.library.sizes)[node.slice.value]), ARRAY)
        return Text(self.element(node), REAL)

    def element(self, node: ast.Subscript) -> str:
        """An element of a list, which Modelica counts from 1."""
        whole = self.expression(node.value)
        if whole.kind is not ARRAY:
            raise _UnknownError(f"'{ast.unparse(node)}'")
        return f"{whole.code}[{self.number(node.slice).at(SUM)} + 1]"

    def on_UnaryOp(self, node: ast.UnaryOp) -> Text:
        if isinstance(node.op, ast.Not):
            return Text(f"not {self.truth(node.operand).at(ATOM)}", TRUTH, NOT)
        value = self.number(node.operand)
        if isinstance(node.op, ast.UAdd):
            return value
        return Text(f"-{value.inner(PRODUCT)}", value.kind, PRODUCT, True)

    def on_BinOp(self, node: ast.BinOp) -> Text:
        left, right = self.number(node.left), self.number(node.right)
        kind = REAL if REAL in (left.kind, right.kind) or isinstance(node.op, ast.Div) else WHOLE
        if isinstance(node.op, ast.Mod):
            return Text(f"mod({left.code}, {right.code})", kind)
        if type(node.op) not in OPERATORS:
            raise _UnknownError(f"'{ast.unparse(node)}'")
        symbol, rank = OPERATORS[type(node.op)]
        if rank == POWER:
            return Text(f"{left.at(ATOM)} ^ {right.at(ATOM)}", kind, POWER)
        text = f"{left.at(rank)} {symbol} {right.inner(rank + 1)}"
        # Modelica reads -a * b as -(a * b), which is the same number
        return Text(text, kind, rank, left.signed)

    def on_Compare(self, node: ast.Compare) -> Text:
        operands = [node.left, *node.comparators]
        texts = [
            f"{self.number(a).at(SUM)} {RELATIONS[type(op)]} {self.number(b).inner(SUM)}"
            for a, op, b in zip(operands, node.ops, operands[1:], strict=False)
        ]
        return Text(" and ".join(texts), TRUTH, AND if len(texts) > 1 else RELATION)

    def on_BoolOp(self, node: ast.BoolOp) -> Text:
        """Modelica may evaluate all operands: where one asks for an element that may not be there, a choice is written."""
        both = isinstance(node.op, ast.And)
        text = self.truth(node.values[-1])
        for value in reversed(node.values[:-1]):
            one = self.truth(value)
            rank = AND if both else OR
            if "[" in text.code:
                rest = f"{text.code} else false" if both else f"true else {text.code}"
                text = Text(f"if {one.code} then {rest}", TRUTH, CHOICE)
            else:
                text = Text(f"{one.at(rank)} {'and' if both else 'or'} {text.at(rank)}", TRUTH, rank)
        return text

    def on_IfExp(self, node: ast.IfExp) -> Text:
        one, other = self.expression(node.body), self.expression(node.orelse)
        kind = joined(one.kind, other.kind)
        if kind is None or kind not in NUMBERS:
            raise _UnknownError(f"'{ast.unparse(node)}'")
        test = self.truth(node.test).code
        return Text(
            f"if {test} then {self.fitting(one, kind)} else {self.fitting(other, kind)}", kind, CHOICE
        )

    def on_Call(self, node: ast.Call) -> Text:
        if isinstance(node.func, ast.Attribute):
            return self.from_math(node, node.func.attr)
        assert isinstance(node.func, ast.Name)
        name = node.func.id
        layouts = self.library.program.layouts
        if name in layouts:
            struct = layouts[name]
            texts = [
                self.fitting(self.expression(a), k) for a, k in zip(node.args, struct.kinds, strict=True)
            ]
            return Text(f"{struct.text}({', '.join(texts)})", struct)
        if name in self.library.program.nodes:
            callee = self.callee(node)
            if self.plain(callee.result) or callee.name in self.library.changes:
                raise _UnknownError(f"'{ast.unparse(node)}' within an expression")
            return Text(self.call_text(callee, node), callee.result)
        arguments = [self.number(a) for a in node.args]
        listed = ", ".join(a.code for a in arguments)
        kind = REAL if any(a.kind is REAL for a in arguments) else WHOLE
        if name in ("min", "max"):
            text = arguments[0].code
            for other in arguments[1:]:
                text = f"{name}({text}, {other.code})"
            return Text(text, kind)
        if name == "abs":
            return Text(f"abs({listed})", kind)
        if name == "float":
            return arguments[0]._replace(kind=REAL)
        if name == "int":
            return arguments[0] if kind is WHOLE else Text(f"Internal.truncated({listed})", WHOLE)
        if name == "len":
            return Text(f"size({self.expression(node.args[0]).code}, 1)", WHOLE)
        raise _UnknownError(f"'{name}'")

    def from_math(self, node: ast.Call, name: str) -> Text:
        listed = ", ".join(self.number(a).code for a in node.args)
        if name == "fabs":
            return Text(f"abs({listed})", REAL)
        if name in PLAIN:
            return Text(f"{name}({listed})", REAL)
        if name in OURS:
            return Text(f"Internal.{name}({listed})", REAL)
        raise _UnknownError(f"math.{name}")

    def callee(self, node: ast.expr) -> Function:
        """The function that a call means, for arguments of these kinds."""
        assert isinstance(node, ast.Call)
        assert isinstance(node.func, ast.Name)
        return self.find(node.func.id, tuple(self.kind_of(a) for a in node.args))

    def kind_of(self, node: ast.expr) -> Kind:
        """As `expression`, but a truth value stays one."""
        return self.expression(node).kind

    def call_text(self, callee: Function, node: ast.Call) -> str:
        """A call without the tuples that nobody looks at."""
        name = self.library.add(callee)
        texts = [
            self.fitting(self.expression(a), kind)
            for k, (a, kind) in enumerate(zip(node.args, callee.parameters.values(), strict=True))
            if not callee.leaves_out(k)
        ]
        return f"{name}({', '.join(texts)})"


def without_continue(body: Sequence[ast.stmt]) -> list[ast.stmt]:
    """Statements of a loop without `continue`, which Modelica lacks: what follows its `if` goes into the branches."""
    done: list[ast.stmt] = []
    for k, statement in enumerate(body):
        if isinstance(statement, ast.Continue):
            return done
        if isinstance(statement, ast.If) and _continues(statement):
            rest = list(body[k + 1 :])
            branches = [
                without_continue(b if _leaves(b) else [*b, *rest]) for b in (statement.body, statement.orelse)
            ]
            if branches[0]:
                done.append(ast.If(statement.test, branches[0], branches[1]))
            else:
                done.append(ast.If(ast.UnaryOp(ast.Not(), statement.test), branches[1], []))
            return done
        done.append(statement)
        if isinstance(statement, ast.Return | ast.Break):
            return done
    return done


def _continues(node: ast.AST) -> bool:
    """True if a `continue` of this loop is within."""
    if isinstance(node, ast.Continue):
        return True
    return any(_continues(n) for n in ast.iter_child_nodes(node) if not isinstance(n, ast.For | ast.While))


def _leaves(body: Sequence[ast.stmt]) -> bool:
    """True if no way through the statements reaches their end."""
    if not body:
        return False
    last = body[-1]
    if isinstance(last, ast.If):
        return _leaves(last.body) and _leaves(last.orelse)
    return isinstance(last, ast.Return | ast.Break | ast.Continue)
