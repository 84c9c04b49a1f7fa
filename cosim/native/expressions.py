"""Python's expressions as C text, with the kind of each; what has no meaning in C is refused with a reason."""

import ast
import math
from collections.abc import Callable, Sequence

from cosim.native.kinds import (
    AND,
    ARRAY,
    ARRAYS,
    ATOM,
    CHOICE,
    EQUALITY,
    NUMBERS,
    OR,
    ORDER,
    PRODUCT,
    REAL,
    SUM,
    TRUTH,
    UNARY,
    WHOLE,
    Kind,
    Struct,
    Value,
    c_name,
    joined,
    real_text,
)

SYMBOLS: dict[type[ast.operator], tuple[str, str, int]] = {
    ast.Add: ("plus", "+", SUM),
    ast.Sub: ("minus", "-", SUM),
    ast.Mult: ("times", "*", PRODUCT),
}
# (helper for doubles, helper for whole numbers)
HELPERS: dict[type[ast.operator], tuple[str, str]] = {
    ast.Add: ("", "py_plus"),
    ast.Sub: ("", "py_minus"),
    ast.Mult: ("", "py_times"),
    ast.Mod: ("py_modulo", "py_whole_modulo"),
    ast.FloorDiv: ("py_floor_divide", "py_whole_floor_divide"),
}
COMPARISONS: dict[type[ast.cmpop], tuple[str, int]] = {
    ast.Lt: ("<", ORDER),
    ast.LtE: ("<=", ORDER),
    ast.Gt: (">", ORDER),
    ast.GtE: (">=", ORDER),
    ast.Eq: ("==", EQUALITY),
    ast.NotEq: ("!=", EQUALITY),
}
# of the module math: those that never fail, by number of arguments, and those that raise
SAFE = {"fabs": 1, "tanh": 1, "atan": 1, "asinh": 1, "erf": 1, "erfc": 1, "atan2": 2, "copysign": 2}
FAILING = dict.fromkeys(
    (
        "acos",
        "acosh",
        "asin",
        "atanh",
        "cos",
        "cosh",
        "exp",
        "expm1",
        "log",
        "log10",
        "log1p",
        "log2",
        "sin",
        "sinh",
    ),
    1,
) | {"sqrt": 1, "tan": 1, "floor": 1, "ceil": 1, "trunc": 1, "fmod": 2}
TESTS = ("isnan", "isinf", "isfinite")
CONSTANTS = {name: getattr(math, name) for name in ("pi", "e", "tau", "inf", "nan")}


class RefusedError(Exception):
    """An expression or statement has no translation; the text says why."""


class Expressions:
    """Translates expressions of one function.

    Attributes:
        env: what each variable is: its C text, kind, and whether it is a pointer.
        fails: whether anything so far can raise in Python.
        with_rates: numbers carry a derivative (`c/rates.h`).
    """

    env: dict[str, Value]
    fails: bool
    with_rates: bool = False
    tuples: Callable[[tuple[Kind, ...]], Struct]
    layouts: dict[str, Struct]

    def expression(self, node: ast.expr) -> Value:
        """C text and kind of an expression.

        Raises:
            RefusedError: it has none.
        """
        method = getattr(self, f"_on_{type(node).__name__}", None)
        if method is None:
            raise RefusedError(f"{type(node).__name__} is not supported")
        found: Value = method(node)
        return found

    def number(self, node: ast.expr) -> Value:
        """An expression that must be a number."""
        value = self.expression(node)
        if value.kind not in NUMBERS:
            raise RefusedError(f"'{ast.unparse(node)}' is {value.kind.text}, where a number is needed")
        return value

    def truth(self, node: ast.expr) -> Value:
        """An expression as a condition: a number is true unless it is zero."""
        value = self.number(node)
        return value if value.kind is TRUTH else Value(f"{self.size(value.real())} != 0.0", TRUTH, EQUALITY)

    def size(self, value: Value) -> str:
        """A number in a comparison: its value alone, where it carries a derivative."""
        return f"pc_value({value.code})" if self.with_rates and value.kind is REAL else value.at(SUM)

    def operation(self, name: str, symbol: str, rank: int, one: Value, other: Value) -> Value:
        """One number by another, double by double; a function where they carry derivatives."""
        if self.with_rates:
            return Value(f"pc_{name}({one.code}, {other.code})", REAL)
        return Value(f"{one.at(rank)} {symbol} {other.at(rank + 1)}", REAL, rank)

    def failing(self, helper: str, *arguments: str) -> str:
        """Text of a call that can raise in Python."""
        self.fails = True
        return f"{helper}({', '.join([*arguments, 'py_fault'])})"

    # Leaves

    def _on_Constant(self, node: ast.Constant) -> Value:
        if isinstance(node.value, bool):
            return Value(str(int(node.value)), TRUTH)
        if isinstance(node.value, float):
            return Value(real_text(node.value), REAL, constant=node.value)
        if isinstance(node.value, int) and abs(node.value) <= 2**53:
            return Value(f"INT64_C({node.value})", WHOLE, constant=node.value)
        raise RefusedError(f"the constant {node.value!r} is no number of at most 2^53")

    def _on_Name(self, node: ast.Name) -> Value:
        if node.id not in self.env:
            raise RefusedError(f"'{node.id}' has no value here")
        return self.env[node.id]

    def _on_Attribute(self, node: ast.Attribute) -> Value:
        if isinstance(node.value, ast.Name) and node.value.id == "math":
            if node.attr not in CONSTANTS:
                raise RefusedError(f"math.{node.attr} is not supported")
            return Value(real_text(CONSTANTS[node.attr]), REAL, constant=CONSTANTS[node.attr])
        whole = self.expression(node.value)
        if not isinstance(whole.kind, Struct) or node.attr not in whole.kind.names:
            raise RefusedError(f"'{ast.unparse(node.value)}' has no field '{node.attr}'")
        kind = whole.kind.kinds[whole.kind.names.index(node.attr)]
        return Value(f"{whole.at(ATOM)}{'->' if whole.pointer else '.'}{c_name(node.attr)}", kind)

    def _on_Subscript(self, node: ast.Subscript) -> Value:
        whole = self.expression(node.value)
        if isinstance(whole.kind, Struct) or whole.kind is ARRAYS:
            if not isinstance(node.slice, ast.Constant) or not isinstance(node.slice.value, int):
                raise RefusedError(f"'{ast.unparse(node)}': the place in a tuple must be a written number")
            i = node.slice.value
            if whole.kind is ARRAYS:
                return Value(f"{whole.code}[{i}]", ARRAY)
            assert isinstance(whole.kind, Struct)
            name, kind = whole.kind.fields[i]
            return Value(f"{whole.at(ATOM)}{'->' if whole.pointer else '.'}{c_name(name)}", kind)
        return Value(self.failing("py_get", *self.element(node, whole)), REAL)

    def element(self, node: ast.Subscript, whole: Value) -> tuple[str, str]:
        """List and place of an element."""
        if whole.kind is not ARRAY or isinstance(node.slice, ast.Slice):
            raise RefusedError(f"'{ast.unparse(node)}': only single elements of lists can be taken")
        place = self.number(node.slice)
        if place.kind is REAL:
            raise RefusedError(
                f"'{ast.unparse(node)}': the place must be whole, such as int({ast.unparse(node.slice)})"
            )
        return whole.code, place.whole().code

    def _on_Tuple(self, node: ast.Tuple) -> Value:
        parts = [self.expression(e) for e in node.elts]
        struct = self.tuples(tuple(p.kind for p in parts))
        return self.made(struct, parts)

    def made(self, struct: Struct, parts: Sequence[Value]) -> Value:
        """A new struct."""
        if len(parts) != len(struct.fields):
            raise RefusedError(f"{struct.text} has {len(struct.fields)} fields, not {len(parts)}")
        texts = []
        for part, (name, kind) in zip(parts, struct.fields, strict=True):
            if joined(part.kind, kind) != kind:
                raise RefusedError(f"field '{name}' of {struct.text} is {kind.text}, not {part.kind.text}")
            texts.append(f"*{part.code}" if part.pointer else part.as_kind(kind).code)
        return Value(f"PY_NEW({struct.c}){{{', '.join(texts) or '0'}}}", struct)

    # Operations

    def _on_UnaryOp(self, node: ast.UnaryOp) -> Value:
        if isinstance(node.op, ast.Not):
            return Value(f"!{self.truth(node.operand).at(UNARY)}", TRUTH, UNARY)
        value = self.number(node.operand)
        value = value.whole() if value.kind is TRUTH else value
        if isinstance(node.op, ast.UAdd):
            return value
        if not isinstance(node.op, ast.USub):
            raise RefusedError("~ is not supported")
        if self.with_rates and value.kind is REAL:
            if value.constant is not None:
                return Value(real_text(-float(value.constant)), REAL, constant=-value.constant)
            return Value(f"pc_negative({value.code})", REAL)
        text = value.at(UNARY)
        constant = None if value.constant is None else -value.constant
        return Value(f"-({text})" if text.startswith("-") else f"-{text}", value.kind, UNARY, constant)

    def _on_BinOp(self, node: ast.BinOp) -> Value:
        left, right = self.number(node.left), self.number(node.right)
        kind = REAL if REAL in (left.kind, right.kind) else WHOLE
        operator = type(node.op)
        if operator is ast.Div:
            one, other = left.real(), right.real()
            if other.constant is not None and other.constant != 0.0:
                return self.operation("over", "/", PRODUCT, one, other)
            return Value(self.failing("py_divide", one.code, other.code), REAL)
        if operator is ast.Pow:
            if kind is WHOLE:
                raise RefusedError(f"'{ast.unparse(node)}': a power of whole numbers; write it with floats")
            return Value(self.failing("py_power", left.real().code, right.real().code), REAL)
        if operator not in HELPERS:
            raise RefusedError(f"'{ast.unparse(node)}': this operator is not supported")
        one, other = left.as_kind(kind), right.as_kind(kind)
        helper = HELPERS[operator][kind is WHOLE]
        if helper:
            return Value(self.failing(helper, one.code, other.code), kind)
        return self.operation(*SYMBOLS[operator], one, other)

    def _on_Compare(self, node: ast.Compare) -> Value:
        operands = [node.left, *node.comparators]
        for middle in operands[1:-1]:
            if any(isinstance(n, ast.Call) for n in ast.walk(middle)):
                raise RefusedError(f"'{ast.unparse(node)}': give '{ast.unparse(middle)}' a name first")
        texts = []
        for left, operator, right in zip(operands, node.ops, operands[1:], strict=False):
            if type(operator) not in COMPARISONS:
                raise RefusedError(f"'{ast.unparse(node)}': this comparison is not supported")
            symbol, rank = COMPARISONS[type(operator)]
            one, other = self.number(left), self.number(right)
            kind = REAL if REAL in (one.kind, other.kind) else WHOLE
            one, other = one.as_kind(kind), other.as_kind(kind)
            texts.append(Value(f"{self.size(one)} {symbol} {self.size(other)}", TRUTH, rank))
        if len(texts) == 1:
            return texts[0]
        return Value(" && ".join(t.at(EQUALITY) for t in texts), TRUTH, AND)

    def _on_BoolOp(self, node: ast.BoolOp) -> Value:
        parts = [self.number(v) for v in node.values]
        if any(p.kind is not TRUTH for p in parts):
            raise RefusedError(f"'{ast.unparse(node)}': compare each number, such as x != 0.0")
        if isinstance(node.op, ast.And):
            return Value(" && ".join(p.at(EQUALITY) for p in parts), TRUTH, AND)
        return Value(" || ".join(p.at(EQUALITY) for p in parts), TRUTH, OR)

    def _on_IfExp(self, node: ast.IfExp) -> Value:
        test, one, other = self.truth(node.test), self.expression(node.body), self.expression(node.orelse)
        kind = joined(one.kind, other.kind)
        if kind is None:
            raise RefusedError(f"'{ast.unparse(node)}': one is {one.kind.text}, the other {other.kind.text}")
        texts = [f"*{v.code}" if v.pointer else v.as_kind(kind).at(OR) for v in (one, other)]
        return Value(f"{test.at(OR)} ? {texts[0]} : {texts[1]}", kind, CHOICE)

    def _on_Call(self, node: ast.Call) -> Value:
        raise NotImplementedError
