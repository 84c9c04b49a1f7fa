"""Calls in Python's expressions as C text: the module math, built-in functions, named tuples, other equations."""

import ast
import math
from collections.abc import Sequence

from cosim.native.expressions import FAILING, SAFE, TESTS, Expressions, RefusedError
from cosim.native.kinds import ARRAY, EQUALITY, PRODUCT, REAL, TRUTH, WHOLE, Value, real_text


class Calls(Expressions):
    """Translates calls."""

    def _on_Call(self, node: ast.Call) -> Value:
        if node.keywords or any(isinstance(a, ast.Starred) for a in node.args):
            raise RefusedError(f"'{ast.unparse(node)}': arguments must be given by place")
        if isinstance(node.func, ast.Attribute):
            return self.from_math(node, node.func)
        if not isinstance(node.func, ast.Name):
            raise RefusedError(f"'{ast.unparse(node)}': only functions with a name can be called")
        name = node.func.id
        if name in self.layouts:
            return self.made(self.layouts[name], [self.expression(a) for a in node.args])
        builtin = getattr(self, f"_builtin_{name}", None)
        if builtin is not None:
            made: Value = builtin(node)
            return made
        return self.of_function(name, node.args)

    def of_function(self, name: str, arguments: Sequence[ast.expr]) -> Value:
        """A call of another equation."""
        raise NotImplementedError

    def from_math(self, node: ast.Call, function: ast.Attribute) -> Value:
        """A call of the module math."""
        name = function.attr
        known = {**SAFE, **FAILING, **dict.fromkeys(TESTS, 1), "pow": 2, "degrees": 1, "radians": 1}
        if not (isinstance(function.value, ast.Name) and function.value.id == "math") or name not in known:
            raise RefusedError(
                f"'{ast.unparse(function)}' is not supported; of the module math there are {', '.join(sorted(known))}"
            )
        if len(node.args) != known[name]:
            raise RefusedError(f"'{ast.unparse(node)}': {known[name]} arguments are supported")
        arguments = [self.number(a).real() for a in node.args]
        texts = [a.code for a in arguments]
        if name in TESTS:
            return Value(f"{name}({texts[0]}) != 0", TRUTH, EQUALITY)
        if name in ("degrees", "radians"):
            factor = 180.0 / math.pi if name == "degrees" else math.pi / 180.0
            by = Value(real_text(factor), REAL, constant=factor)
            return self.operation("times", "*", PRODUCT, arguments[0], by)
        if name in SAFE:
            return Value(f"{name}({', '.join(texts)})", REAL)
        return Value(self.failing("py_power" if name == "pow" else f"py_{name}", *texts), REAL)

    def single(self, node: ast.Call) -> Value:
        """The only argument of a call, a number."""
        if len(node.args) != 1:
            raise RefusedError(f"'{ast.unparse(node)}': one argument is supported")
        return self.number(node.args[0])

    def _builtin_float(self, node: ast.Call) -> Value:
        return self.single(node).real()

    def _builtin_bool(self, node: ast.Call) -> Value:
        self.single(node)
        return self.truth(node.args[0])

    def _builtin_int(self, node: ast.Call) -> Value:
        value = self.single(node)
        return Value(self.failing("py_whole", value.code), WHOLE) if value.kind is REAL else value.whole()

    def _builtin_abs(self, node: ast.Call) -> Value:
        value = self.single(node)
        if value.kind is REAL:
            return Value(f"fabs({value.code})", REAL)
        return Value(f"py_whole_abs({value.whole().code})", WHOLE)

    def _builtin_round(self, node: ast.Call) -> Value:
        value = self.single(node)
        return Value(self.failing("py_round", value.code), REAL) if value.kind is REAL else value.whole()

    def _builtin_len(self, node: ast.Call) -> Value:
        value = self.expression(node.args[0]) if len(node.args) == 1 else None
        if value is None or value.kind is not ARRAY:
            raise RefusedError(f"'{ast.unparse(node)}': only the length of a list is supported")
        return Value(f"{value.code}.length", WHOLE)

    def _builtin_pow(self, node: ast.Call) -> Value:
        if len(node.args) != 2:
            raise RefusedError(f"'{ast.unparse(node)}': two arguments are supported")
        return self._on_BinOp(ast.BinOp(node.args[0], ast.Pow(), node.args[1]))

    def _builtin_min(self, node: ast.Call) -> Value:
        return self.extreme(node, "min")

    def _builtin_max(self, node: ast.Call) -> Value:
        return self.extreme(node, "max")

    def extreme(self, node: ast.Call, name: str) -> Value:
        """Smallest or largest of two or more numbers."""
        values = [self.number(a) for a in node.args]
        if len(values) < 2:
            raise RefusedError(f"'{ast.unparse(node)}': give two numbers or more")
        kind = REAL if any(v.kind is REAL for v in values) else WHOLE
        helper = f"py_{name}" if kind is REAL else f"py_whole_{name}"
        text = values[0].as_kind(kind).code
        for value in values[1:]:
            text = f"{helper}({text}, {value.as_kind(kind).code})"
        return Value(text, kind)
