"""Flatten a composed block into one closure that makes a step: the form that an FMU runs.

The composed text hands named tuples from function to function; in CPython most of a step's time goes into making them and
looking up their fields. Here the same statements are rearranged, never rewritten: a field becomes a variable of the
enclosing function (``p.K`` becomes ``p__K``), functions lose the tuple arguments, a function that is one expression takes
its callers' place, and the step stores its outputs itself. Every arithmetic operation stays, in its order, so the numbers
are the same bit for bit (tests/fmus/test_specialise.py).
"""

import ast
import copy
from dataclasses import dataclass, field
from functools import lru_cache
from textwrap import indent

from fmus.compose import Composed
from fmus.syntax import calls, collect, names, parsed

TAKEN = ("values", "now", "resized", "failed", "stale")
TUPLES = {"x": "State", "x1": "State", "u": "Input", "m": "Memory", "p": "Parameters", "c": "Coefficients"}

TEMPLATE = '''"""{title}"""
import math

def stepper(values, p, c, x, m, h, resized, failed, stale=[False]):
    """Make a step; take coefficients of another step size; tell state and memory."""
    {p}*_ = p
    {c}= c
    {x}= x
    {m}*others, = m
    h__step = h
{functions}
    def renew(new, h):
        nonlocal h__step, {c_names}
        h__step, {c}= h, *new
    def running():
        return ({x}), ({m}*others,)
    return do_step, renew, running
'''
HEADER = """\
if do__step != h__step and not resized(do__time, do__step):
    return False
"""
CLOCK = """\
if not -1e9 < do__time < 1e9:
    return failed(do__time, None)
now = do__time + do__step
"""


def flat_text(composed: Composed) -> str:
    """Text of a module that defines ``stepper(values, p, c, x, m, h, resized, failed, stale) -> (do_step, renew, running)``.

    ``values`` is a list of inputs, outputs and whatever follows; ``do_step(time, step)`` reads inputs there, makes a step, stores
    the outputs and gives True. Before a step that is not exactly `h` long it asks ``resized(time, step)``, which calls
    ``renew(c, step)`` with the coefficients of that size, or leaves them, or gives False, which ends the step. What raises, or makes a
    first output that is no number, ends with what ``failed(time, error or None)`` gives. ``running()`` gives (x, m). Where outputs
    follow inputs at once, a step clears ``stale[0]``. ``p`` and ``m`` may have more fields than the block has (those of effects that are off): they are left alone.

    Raises:
        ValueError: an equation uses a named tuple in a way that cannot be flattened; the message names it.
    """
    block = composed.block
    inputs = tuple((name, variable.kind) for name, variable in block.inputs.items())
    return _made(_Woven((composed.source, inputs, tuple(composed.outputs), composed.direct), composed))


@dataclass(frozen=True)
class _Woven:
    """A composed block, equal to any other of the same text: other start values change nothing of it."""

    known_by: tuple[object, ...]
    composed: Composed = field(compare=False)


@lru_cache(maxsize=256)
def _made(woven: _Woven) -> str:
    return _Flat(woven.composed).text()


class _Flat:
    def __init__(self, composed: Composed) -> None:
        self.composed = composed
        tree = parsed(composed.source)
        self.functions = {node.name: node for node in tree.body if isinstance(node, ast.FunctionDef)}
        layouts = {name: list(getattr(composed.module, name)._fields) for name in TUPLES.values()}
        self.fields = {kind: [f"{kind}__{n}" for n in layouts[layout]] for kind, layout in TUPLES.items()}
        # of each function, its parameters that are tuples, and of which kind; the name alone does not tell
        self.tuples: dict[str, dict[str, str]] = {"advance": {kind: kind for kind in TUPLES}}
        self.follow_calls("advance")
        self.bind("output", {kind: kind for kind in "xump"})
        self.flat = {name: self.flattened(name) for name in self.tuples if name != "advance"}
        self.inline()

    def bind(self, name: str, tuples: dict[str, str]) -> None:
        known = name in self.tuples
        if self.tuples.setdefault(name, tuples) != tuples:
            raise ValueError(
                f"{name} gets different tuples from its callers: {tuples} and {self.tuples[name]}"
            )
        if not known:
            self.follow_calls(name)

    def follow_calls(self, caller: str) -> None:
        tuples = self.tuples[caller]
        for name, call in calls(self.functions[caller]):
            if name in self.functions:
                parameters = [a.arg for a in self.functions[name].args.args]
                bound = {
                    parameter: tuples[argument.id]
                    for parameter, argument in zip(parameters, call.args, strict=True)
                    if isinstance(argument, ast.Name) and argument.id in tuples
                }
                self.bind(name, bound)

    def flattened(self, name: str) -> ast.FunctionDef:
        """One function without tuple arguments and docstring."""
        node = copy.deepcopy(self.functions[name])
        node.args.args = [a for a in node.args.args if a.arg not in self.tuples[name]]
        for variable in [a.arg for a in node.args.args] + list(names(node, ast.Store)):
            if "__" in variable or variable in TAKEN:
                raise ValueError(
                    f"{name} has a variable '{variable}': {', '.join(TAKEN)} and double underscores are taken"
                )
        node.body = self.without_tuples(name, node.body[1:] if ast.get_docstring(node) else node.body)
        return node

    def without_tuples(self, name: str, body: list[ast.stmt]) -> list[ast.stmt]:
        fields = _Fields(name, self.tuples, self.fields, self.functions)
        return [fields.visit(copy.deepcopy(statement)) for statement in body]

    def inline(self) -> None:
        """Functions that are one expression take the place of their calls."""
        short = {
            name: node
            for name, node in self.flat.items()
            if len(node.body) == 1 and name not in ("step", "output")
        }
        for node in self.flat.values():
            while _Inliner(short).changes(node):
                pass

    def advance(self) -> ast.FunctionDef:
        """Inputs, memory before the step, the step; memory after it and outputs in place of each of its returns."""
        body = self.functions["advance"].body
        at = next(
            i for i, s in enumerate(body) if isinstance(s, ast.Assign) and names(s, ast.Store) == {"x1"}
        )
        before, after = (self.without_tuples("advance", part) for part in (body[:at], body[at + 1 : -1]))
        x, x1 = (", ".join(self.fields[kind]) + "," for kind in ("x", "x1"))
        inputs = [
            f"u__{name} = {'now' if variable.kind == 'time' else f'values[{i}]'}"
            for i, (name, variable) in enumerate(self.composed.block.inputs.items())
        ]
        end = [*after, *parsed(f"{x} = {x1}").body] if after else []
        first = len(self.composed.inputs)
        sound = parsed(f"-1e300 < values[{first}] < 1e300 or failed(do__time, None)").body[0]
        assert isinstance(sound, ast.Expr)
        returns = _Returns(x1 if after else x, [*end, *self.stores()], sound.value)
        step = ast.Module([*before, *copy.deepcopy(self.flat["step"].body)], [])
        returns.visit(step)
        frame = "def do_step(do__time, do__step):\n    try:\n        pass\n    except Exception as do__error:\n        return failed(do__time, do__error)"
        node = parsed(frame).body[0]
        assert isinstance(node, ast.FunctionDef)
        guarded = node.body[0]
        assert isinstance(guarded, ast.Try)
        header = HEADER + (CLOCK if self.composed.takes_time else "")
        header += "stale[0] = False\n" if self.composed.direct else ""
        guarded.body = [*parsed(header).body, *parsed("\n".join(inputs)).body, *step.body]
        return node

    def stores(self) -> list[ast.stmt]:
        """Statements that put the outputs into the list of values."""
        first = len(self.composed.inputs)
        *statements, last = self.flat["output"].body
        if any(isinstance(n, ast.Return) for s in statements for n in ast.walk(s)) or not isinstance(
            last, ast.Return
        ):
            return parsed(f"values[{first}:{first + len(self.composed.outputs)}] = output()").body
        assert isinstance(last.value, ast.Tuple)
        targets = parsed("\n".join(f"values[{first + i}] = 0" for i in range(len(last.value.elts)))).body
        for target, value in zip(targets, last.value.elts, strict=True):
            assert isinstance(target, ast.Assign)
            target.value = value
        return [*statements, *targets]

    def text(self) -> str:
        advance = self.advance()
        others: list[ast.FunctionDef] = []
        collect(advance, self.flat, others)
        shared = {n for other in others for n in names(other, ast.Load)} | {
            *self.fields["x"],
            *self.fields["m"],
        }
        outer = sorted(n for n in shared & names(advance, ast.Store) if "__" in n)
        starts = [f"{name} = 0.0" for name in outer if name.startswith(("u__", "x1__"))]
        if outer:
            advance.body.insert(0, ast.Nonlocal(outer))
        texts = [*starts, *(ast.unparse(ast.fix_missing_locations(f)) for f in (*others, advance))]
        listed = {kind: "".join(f"{n}, " for n in self.fields[kind]) for kind in TUPLES}
        text = TEMPLATE.format(
            title=ast.get_docstring(parsed(self.composed.source)),
            functions=indent("\n".join(texts), "    "),
            c_names=", ".join(self.fields["c"]),
            **{kind: listed[kind] for kind in "pcxm"},
        )
        compile(text, f"stepper of {self.composed.block.name}", "exec")
        return text


class _Fields(ast.NodeTransformer):
    """Fields of tuples become variables, tuple arguments vanish, and tuples that are made are plain."""

    def __init__(
        self,
        name: str,
        tuples: dict[str, dict[str, str]],
        fields: dict[str, list[str]],
        functions: dict[str, ast.FunctionDef],
    ) -> None:
        self.name, self.own, self.tuples, self.fields, self.functions = (
            name,
            tuples[name],
            tuples,
            fields,
            functions,
        )

    def visit_Attribute(self, node: ast.Attribute) -> ast.AST:
        if isinstance(node.value, ast.Name) and node.value.id in self.own:
            return ast.Name(f"{self.own[node.value.id]}__{node.attr}", node.ctx)
        if isinstance(node.value, ast.Name) and node.value.id == "math":
            return node
        raise ValueError(
            f"{self.name}: {ast.unparse(node)} cannot be flattened; take the fields of x, u, m, p and c only"
        )

    def visit_Name(self, node: ast.Name) -> ast.AST:
        if node.id in self.own:
            raise ValueError(
                f"{self.name}: the tuple {node.id} cannot be flattened; hand it on to a function, or take its fields"
            )
        return node

    def visit_Call(self, node: ast.Call) -> ast.AST:
        name = node.func.id if isinstance(node.func, ast.Name) else ""
        if name in self.functions:
            parameters = [a.arg for a in self.functions[name].args.args]
            gone = self.tuples[name]
            node.args = [a for p, a in zip(parameters, node.args, strict=True) if p not in gone]
        self.generic_visit(node)
        return ast.Tuple(node.args, ast.Load()) if name in ("State", "Output") else node

    def visit_Assign(self, node: ast.Assign) -> ast.AST:
        if names(node, ast.Store) == {"m"} and "m" in self.own:
            # advance makes a new memory; what stays the same is not assigned
            assert isinstance(node.value, ast.Call)
            values = [self.visit(a) for a in node.value.args]
            pairs = [(f, v) for f, v in zip(self.fields["m"], values, strict=True) if ast.unparse(v) != f]
            targets: list[ast.expr] = [ast.Name(f, ast.Store()) for f, _ in pairs]
            return ast.Assign([ast.Tuple(targets, ast.Store())], ast.Tuple([v for _, v in pairs], ast.Load()))
        return self.generic_visit(node)


class _Inliner(ast.NodeTransformer):
    """Puts the expression of short functions in place of their calls, where no argument would be computed twice."""

    def __init__(self, short: dict[str, ast.FunctionDef]) -> None:
        self.short, self.changed = short, False

    def changes(self, node: ast.AST) -> bool:
        """Visit; True if anything changed."""
        self.visit(node)
        return self.changed

    def visit_Call(self, node: ast.Call) -> ast.AST:
        self.generic_visit(node)
        function = self.short.get(node.func.id) if isinstance(node.func, ast.Name) else None
        if function is None:
            return node
        body = function.body[0]
        assert isinstance(body, ast.Return)
        assert body.value is not None
        arguments = dict(zip((a.arg for a in function.args.args), node.args, strict=True))
        used = [n.id for n in ast.walk(body.value) if isinstance(n, ast.Name)]
        if any(
            used.count(p) > 1 and not isinstance(a, ast.Name | ast.Constant) for p, a in arguments.items()
        ):
            return node
        self.changed = True
        return _Replace(arguments).visit(copy.deepcopy(body.value))


class _Replace(ast.NodeTransformer):
    def __init__(self, values: dict[str, ast.expr]) -> None:
        self.values = values

    def visit_Name(self, node: ast.Name) -> ast.AST:
        return copy.deepcopy(self.values.get(node.id, node))


class _Returns(ast.NodeTransformer):
    """In place of ``return value``: assign the value, do what follows a step, return whether the step is sound."""

    def __init__(self, target: str, after: list[ast.stmt], sound: ast.expr) -> None:
        self.target, self.after, self.sound = target, after, sound

    def visit_Return(self, node: ast.Return) -> list[ast.stmt]:
        assert node.value is not None
        assign = parsed(f"{self.target} = 0").body[0]
        assert isinstance(assign, ast.Assign)
        assign.value = node.value
        return [assign, *copy.deepcopy(self.after), ast.Return(copy.deepcopy(self.sound))]
