"""What the outputs and states of a block depend on, read from the text of its equations: for FMI's ModelStructure.

The composed text is followed with sets of names in place of numbers. A value holds the names that it may depend on, those of
the conditions under which it was assigned among them; a loop is followed until nothing is added. So the sets are never too
small, and too large only where terms cancel.
"""

import ast
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache, wraps

from fmus.compose import Composed, Known
from fmus.contract import Buffer
from fmus.syntax import names, parsed

Names = frozenset[str]
NONE: Names = frozenset()


@dataclass
class Row:
    """A list that is remembered: all its elements depend on the same names."""

    names: Names


@dataclass(frozen=True)
class Fields:
    """A tuple; `keys` are empty for a plain one."""

    keys: tuple[str, ...]
    values: tuple["Value", ...]


Value = Names | Row | Fields
LAYOUTS = ("Input", "Output", "State", "Memory", "Parameters", "Coefficients")


def _once(question: Callable[..., dict[str, Names]]) -> Callable[..., dict[str, Names]]:
    """A question that is answered once for blocks of the same text: FMUs of several packages and versions ask it again."""
    kept = lru_cache(maxsize=256)(lambda asked, **more: question(asked.composed, **more))

    @wraps(question)
    def answered(composed: Composed, **more: bool) -> dict[str, Names]:
        names = (composed.block.inputs, composed.inputs, composed.parameters)
        return dict(kept(Known((composed.source, *map(tuple, names)), composed), **more))

    return answered


@_once
def at_start(composed: Composed, time: bool = False) -> dict[str, Names]:
    """Inputs and parameters on which each output, and each state as ``x.name``, depends at initialisation.

    Args:
        composed: the block with its effects.
        time: the communication time counts too, by the name that the block gives it; to FMI 2.0 it is no variable.
    """
    text = _Text(composed)
    p, u = text.layout("Parameters"), text.layout("Input")
    x = text.call("start", [u, p])
    lists = [b for b in composed.memory.values() if isinstance(b, Buffer)]
    m = text.call("begin", [x, u, p, Fields((), tuple(Row(NONE) for _ in lists))])
    found = named(text.call("output", [x, u, m, p]))
    known = frozenset(composed.block.inputs if time else composed.inputs) | frozenset(composed.parameters)
    found |= {f"x.{name}": names for name, names in named(x).items()}
    return {name: names & known for name, names in found.items()}


@_once
def after_step(composed: Composed) -> dict[str, Names]:
    """Inputs, parameters and states (as ``x.name``) on which each state depends after a step, without what is remembered."""
    text = _Text(composed)
    p, u, x = text.layout("Parameters"), text.layout("Input"), text.layout("State", "x.")
    c = text.call("coefficients", [p, NONE])
    return dict(named(text.call("step", [x, u, text.layout("Memory", "m."), p, c])))


@_once
def of_states(composed: Composed) -> dict[str, Names]:
    """States (as ``x.name``) on which each output depends."""
    text = _Text(composed)
    x, m, p = text.layout("State", "x."), text.layout("Memory", "m."), text.layout("Parameters")
    found = named(text.call("output", [x, text.layout("Input"), m, p]))
    states = frozenset(f"x.{name}" for name in composed.block.states)
    return {name: names & states for name, names in found.items()}


def named(value: Value) -> dict[str, Names]:
    """The names behind each field of a named tuple."""
    assert isinstance(value, Fields)
    return {key: flat(one) for key, one in zip(value.keys, value.values, strict=True)}


def flat(value: Value) -> Names:
    """All names behind a value."""
    if isinstance(value, Row):
        return value.names
    if isinstance(value, Fields):
        return NONE.union(*map(flat, value.values))
    return value


def with_names(value: Value, names: Names) -> Value:
    """The value, depending on more."""
    if isinstance(value, Row):
        value.names |= names
        return value
    if isinstance(value, Fields):
        return Fields(value.keys, tuple(with_names(v, names) for v in value.values))
    return value | names


def joined(one: Value | None, other: Value) -> Value:
    """What holds either value."""
    if one is None or one is other:
        return other
    if isinstance(one, Fields) and isinstance(other, Fields) and len(one.values) == len(other.values):
        return Fields(one.keys, tuple(joined(a, b) for a, b in zip(one.values, other.values, strict=True)))
    return with_names(other, flat(one))


@dataclass
class _Frame:
    """A call that is being followed: its variables, what it returns so far, and the conditions under which it is there."""

    variables: dict[str, Value]
    result: Value | None = None
    conditions: Names = NONE


class _Text:
    """The functions of a composed text."""

    def __init__(self, composed: Composed) -> None:
        self.composed = composed
        tree = parsed(composed.source)
        self.functions = {node.name: node for node in tree.body if isinstance(node, ast.FunctionDef)}
        self.fields = {name: tuple(getattr(composed.module, name)._fields) for name in LAYOUTS}
        # functions that are being followed: one that calls itself is not followed again
        self.open: list[str] = []
        self.within: dict[ast.stmt, tuple[bool, list[ast.expr]]] = {}

    def layout(self, name: str, prefix: str = "") -> Fields:
        """A named tuple whose fields depend on themselves."""
        keys = self.fields[name]
        return Fields(keys, tuple(frozenset({f"{prefix}{key}"}) for key in keys))

    def call(self, name: str, arguments: Sequence[Value], conditions: Names = NONE) -> Value:
        """Follow a function that is called under conditions."""
        node = self.functions[name]
        given = dict(zip((a.arg for a in node.args.args), arguments, strict=True))
        frame = _Frame(given, conditions=conditions)
        self.open.append(name)
        self.follow(node.body, frame)
        self.open.pop()
        return NONE if frame.result is None else frame.result

    def follow(self, body: Sequence[ast.stmt], frame: _Frame) -> None:
        """Follow statements; after one that may leave, all that comes depends on whether it did."""
        for statement in body:
            self.statement(statement, frame)
            if isinstance(statement, ast.If | ast.While | ast.For):
                leaves, conditions = self.inside(statement)
                if leaves:
                    frame.conditions |= NONE.union(*(flat(self.value(c, frame)) for c in conditions))

    def inside(self, statement: ast.stmt) -> tuple[bool, list[ast.expr]]:
        """Whether a statement may leave, and all conditions in it: looked for once, however often it is followed."""
        if statement not in self.within:
            nodes = list(ast.walk(statement))
            tests = [n.test for n in nodes if isinstance(n, ast.If | ast.While)]
            loops = [n.iter for n in nodes if isinstance(n, ast.For)]
            leaves = any(isinstance(n, ast.Return | ast.Break | ast.Continue) for n in nodes)
            self.within[statement] = leaves, [*tests, *loops]
        return self.within[statement]

    def statement(self, node: ast.stmt, frame: _Frame) -> None:
        """Follow one statement."""
        if isinstance(node, ast.Return):
            value = NONE if node.value is None else self.value(node.value, frame)
            frame.result = joined(frame.result, with_names(value, frame.conditions))
        elif isinstance(node, ast.Assign):
            value = self.value(node.value, frame)
            for target in node.targets:
                self.assign(target, value, frame)
        elif isinstance(node, ast.AugAssign):
            before = self.value(node.target, frame)
            self.assign(node.target, flat(before) | flat(self.value(node.value, frame)), frame)
        elif isinstance(node, ast.If):
            self.branches(self.value(node.test, frame), (node.body, node.orelse), frame)
        elif isinstance(node, ast.While | ast.For):
            self.loop(node, frame)
        elif isinstance(node, ast.Expr):
            self.value(node.value, frame)
        else:  # of any other kind: whatever it reads may be behind whatever it assigns or returns
            read = self.read(node, frame) | frame.conditions
            for name in names(node, ast.Store):
                frame.variables[name] = flat(frame.variables.get(name, NONE)) | read
            if any(isinstance(n, ast.Return) for n in ast.walk(node)):
                frame.result = joined(frame.result, read)

    def branches(self, test: Value, bodies: Sequence[Sequence[ast.stmt]], frame: _Frame) -> None:
        """Follow each branch from the same variables; either may have been taken."""
        outer, before = frame.conditions, dict(frame.variables)
        found: dict[str, Value] = {}
        for body in bodies:
            frame.variables, frame.conditions = dict(before), outer | flat(test)
            self.follow(body, frame)
            found = {
                name: joined(found.get(name), value) for name, value in {**found, **frame.variables}.items()
            }
        frame.variables, frame.conditions = found, outer

    def loop(self, node: ast.While | ast.For, frame: _Frame) -> None:
        """Follow a loop until its variables hold nothing new."""
        before: dict[str, Names] | None = None
        while before != (now := {n: flat(v) for n, v in frame.variables.items()}):
            before = now
            test = self.value(node.test if isinstance(node, ast.While) else node.iter, frame)
            body = list(node.body)
            if isinstance(node, ast.For):
                self.assign(node.target, test, frame)
            kept = dict(frame.variables)
            self.branches(test, (body, []), frame)
            frame.variables = {n: joined(kept.get(n), v) for n, v in frame.variables.items()}

    def assign(self, target: ast.expr, value: Value, frame: _Frame) -> None:
        """Give a value to a name, several names, or an element of a list."""
        if isinstance(target, ast.Name):
            frame.variables[target.id] = with_names(value, frame.conditions)
        elif isinstance(target, ast.Tuple):
            plain = isinstance(value, Fields) and len(value.values) == len(target.elts)
            parts = value.values if plain and isinstance(value, Fields) else [flat(value)] * len(target.elts)
            for one, part in zip(target.elts, parts, strict=True):
                self.assign(one, part, frame)
        elif isinstance(target, ast.Subscript):
            place = self.value(target.slice, frame)
            with_names(self.value(target.value, frame), flat(place) | flat(value) | frame.conditions)

    def value(self, node: ast.expr, frame: _Frame) -> Value:
        """Follow an expression."""
        if isinstance(node, ast.Name):
            return frame.variables.get(node.id, NONE)
        if isinstance(node, ast.Attribute):
            whole = self.value(node.value, frame)
            if isinstance(whole, Fields) and node.attr in whole.keys:
                return whole.values[whole.keys.index(node.attr)]
            return flat(whole)
        if isinstance(node, ast.Tuple):
            return Fields((), tuple(self.value(e, frame) for e in node.elts))
        if isinstance(node, ast.IfExp):
            test = flat(self.value(node.test, frame))
            either = joined(self.value(node.body, frame), self.value(node.orelse, frame))
            return with_names(either, test)
        if isinstance(node, ast.Subscript):
            whole, place = self.value(node.value, frame), node.slice
            if isinstance(whole, Fields) and isinstance(place, ast.Constant) and isinstance(place.value, int):
                return whole.values[place.value]
            return flat(whole) | flat(self.value(place, frame))
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
            arguments = [self.value(a, frame) for a in node.args]
            by_place = not node.keywords and not any(isinstance(a, ast.Starred) for a in node.args)
            if node.func.id in self.functions and by_place and node.func.id not in self.open:
                return self.call(node.func.id, arguments, frame.conditions)
            if node.func.id in self.fields and by_place:
                return Fields(self.fields[node.func.id], tuple(arguments))
        parts = list(ast.iter_child_nodes(node))
        inner = NONE.union(*(flat(self.value(n, frame)) for n in parts if isinstance(n, ast.expr)))
        return inner.union(*(self.read(n, frame) for n in parts if not isinstance(n, ast.expr)))

    def read(self, node: ast.AST, frame: _Frame) -> Names:
        """Names behind all variables that a piece of text reads."""
        return NONE.union(*(flat(frame.variables.get(n, NONE)) for n in names(node, ast.Load)))


def through(
    outputs: Mapping[tuple[str, str], Names], sources: Mapping[tuple[str, str], tuple[str, str]]
) -> dict[tuple[str, str], Names]:
    """What outputs of components in wires depend on: inputs and parameters of the whole.

    Args:
        outputs: (component, output) -> names of the component's own inputs and parameters.
        sources: (component, input) -> what feeds it: (component, output), or ("", input of the whole).

    Returns:
        (component, output) -> inputs of the whole, and parameters as ``component.parameter``.
    """
    found: dict[tuple[str, str], Names] = dict.fromkeys(outputs, NONE)
    while True:
        before = dict(found)
        for (component, output), behind in outputs.items():
            own = NONE
            for name in behind:
                source = sources.get((component, name), (component, ""))
                if source[1] == "":
                    own |= {f"{component}.{name}"}
                else:
                    own |= found[source] if source[0] else {source[1]}
            found[component, output] = own
        if found == before:
            return found
