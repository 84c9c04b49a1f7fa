"""Python's statements as C text: blocks, assignments, flow."""

import ast
from collections import Counter
from collections.abc import Sequence

from cosim.native.calls import Calls
from cosim.native.expressions import RefusedError
from cosim.native.kinds import AND, ATOM, NONE, NUMBERS, WHOLE, Kind, Struct, Value, c_name, joined
from fmus.syntax import parsed


class Statements(Calls):
    """Translates statements of one function.

    Attributes:
        kinds: of every variable, as known so far.
        result: kind of what the function returns.
        stores, loads: how often each variable is assigned, and which are read.
        late: variables that a nested block assigns first: declared at the top.
        fails_before: whether the function can fail, as the pass before found it.
    """

    kinds: dict[str, Kind]
    result: Kind
    stores: Counter[str]
    loads: set[str]
    lines: list[str]
    late: list[str]
    indent: str
    depth: int
    temporaries: int
    fails_before: bool

    def line(self, text: str) -> None:
        """Add a line."""
        self.lines.append(self.indent + text)

    def nested(self, head: str, body: Sequence[ast.stmt], first: str = "", tail: str = "}") -> bool:
        """A block in braces that begins with the line `first`; True if it never runs through."""
        self.line(head)
        self.indent += "    "
        self.depth += 1
        if first:
            self.line(first)
        ends = self.block(body)
        self.depth -= 1
        self.indent = self.indent[:-4]
        if tail:
            self.line(tail)
        return ends

    def block(self, body: Sequence[ast.stmt]) -> bool:
        """Statements; True if every way through them returns."""
        ends = False
        for statement in body:
            method = getattr(self, f"_do_{type(statement).__name__}", None)
            try:
                if method is None:
                    raise RefusedError(f"{type(statement).__name__} is not supported")
                ends = bool(method(statement)) or ends
            except RefusedError as error:
                if str(error).startswith("line "):
                    raise
                text = ast.unparse(statement).partition("\n")[0]
                raise RefusedError(f"line '{text}': {error}") from None
        return ends

    # Assignments

    def seen(self, name: str, kind: Kind) -> None:
        """Take note of what a variable is."""
        found = joined(self.kinds.get(name), kind)
        if found is None:
            raise RefusedError(f"'{name}' is {self.kinds[name].text} and {kind.text}")
        self.kinds[name] = found

    def assign(self, name: str, value: Value) -> None:
        """Give a variable a value; where it is the first time at the outermost level, declare it there."""
        if value.kind is NONE or (value.kind not in NUMBERS and not isinstance(value.kind, Struct)):
            raise RefusedError(f"'{name}' would be {value.kind.text}")
        self.seen(name, value.kind)
        kind = self.kinds[name]
        text = f"*{value.code}" if value.pointer else value.as_kind(kind).code
        target = c_name(name)
        if name in self.env:
            self.line(f"{target} = {text};")
        elif self.depth == 0:
            const = "const " if self.stores[name] == 1 else ""
            self.line(f"{const}{kind.c} {target} = {text};")
        else:
            self.late.append(name)
            self.line(f"{target} = {text};")
        self.env[name] = Value(target, kind)

    def temporary(self, value: Value) -> Value:
        """A name of our own for a value."""
        self.temporaries += 1
        name = f"py_{self.temporaries}"
        self.line(f"const {value.kind.c} {name} = {f'*{value.code}' if value.pointer else value.code};")
        return Value(name, value.kind)

    def _do_Assign(self, node: ast.Assign) -> None:
        if len(node.targets) != 1:
            raise RefusedError("assign to one target at a time")
        self.store(node.targets[0], node.value)

    def _do_AnnAssign(self, node: ast.AnnAssign) -> None:
        if node.value is not None:
            self.store(node.target, node.value)

    def _do_AugAssign(self, node: ast.AugAssign) -> None:
        [target] = parsed(ast.unparse(node.target)).body
        assert isinstance(target, ast.Expr)
        self.store(node.target, ast.BinOp(target.value, node.op, node.value))

    def store(self, target: ast.expr, source: ast.expr) -> None:
        """An assignment to a variable, an element of a list, or several variables."""
        if isinstance(target, ast.Name):
            value = self.expression(source)
            if target.id in self.loads:
                self.assign(target.id, value)
            else:
                self.line(f"(void){value.at(ATOM)};")
        elif isinstance(target, ast.Subscript):
            whole, place = self.element(target, self.expression(target.value))
            self.line(f"{self.failing('py_set', whole, place, self.number(source).real().code)};")
        elif isinstance(target, ast.Tuple) and all(isinstance(e, ast.Name) for e in target.elts):
            self.unpack([e.id for e in target.elts if isinstance(e, ast.Name)], source)
        else:
            raise RefusedError(f"'{ast.unparse(target)}' cannot be assigned to")

    def unpack(self, targets: list[str], source: ast.expr) -> None:
        """Several variables at once; the values are computed before any is assigned."""
        if isinstance(source, ast.Tuple):
            values = [self.expression(e) for e in source.elts]
            read = {n.id for e in source.elts for n in ast.walk(e) if isinstance(n, ast.Name)}
            if read & set(targets):
                values = [self.temporary(v) for v in values]
        else:
            whole = self.expression(source)
            if not isinstance(whole.kind, Struct):
                raise RefusedError(f"'{ast.unparse(source)}' is {whole.kind.text} and cannot be unpacked")
            struct = whole.kind
            if not whole.code.isidentifier():
                whole = self.temporary(whole)
            dot = "->" if whole.pointer else "."
            values = [Value(f"{whole.code}{dot}{c_name(n)}", k) for n, k in struct.fields]
        if len(values) != len(targets):
            raise RefusedError(f"{len(values)} values for {len(targets)} variables")
        for name, value in zip(targets, values, strict=True):
            if name in self.loads:
                self.assign(name, value)

    # Flow

    def _do_Pass(self, node: ast.Pass) -> None:
        pass

    def _do_Break(self, node: ast.Break) -> None:
        self.line("break;")

    def _do_Continue(self, node: ast.Continue) -> None:
        self.line("continue;")

    def _do_Expr(self, node: ast.Expr) -> None:
        if isinstance(node.value, ast.Constant):
            return
        value = self.expression(node.value)
        self.line(f"{'' if value.kind is NONE else '(void)'}{value.at(ATOM)};")

    def _do_Return(self, node: ast.Return) -> bool:
        if node.value is None:
            if self.result is not NONE:
                raise RefusedError("it returns a value elsewhere")
            self.line("return;")
            return True
        value = self.expression(node.value)
        found = joined(None if self.result is NONE else self.result, value.kind)
        if isinstance(value.kind, Struct) and isinstance(self.result, Struct) and found is None:
            found = self.wider(self.result, value.kind)
        if found is None or value.kind is NONE:
            raise RefusedError(f"it returns {value.kind.text} here and {self.result.text} elsewhere")
        self.result = found
        self.line(f"return {f'*{value.code}' if value.pointer else value.as_kind(found).code};")
        return True

    def wider(self, one: Struct, other: Struct) -> Kind | None:
        """The plain tuple that holds both; what returns the narrower one is refused by the C compiler, so we do it here."""
        kinds = [joined(a, b) for a, b in zip(one.kinds, other.kinds, strict=False)]
        if len(one.fields) != len(other.fields) or None in kinds:
            return None
        raise RefusedError(
            "it returns tuples of whole numbers and of floats: write the whole ones as floats, such as 0.0"
        )

    def _do_If(self, node: ast.If, head: str = "if") -> bool:
        head = f"{head} ({self.truth(node.test).code}) {{"
        if not node.orelse:
            self.nested(head, node.body)
            return False
        first = self.nested(head, node.body, tail="")
        if len(node.orelse) == 1 and isinstance(node.orelse[0], ast.If):
            return self._do_If(node.orelse[0], "} else if") and first
        return self.nested("} else {", node.orelse) and first

    def _do_While(self, node: ast.While) -> bool:
        if node.orelse:
            raise RefusedError("else after a loop is not supported")
        self.fails = True  # a fault must end it: what it waits for may never come
        self.nested(f"while (*py_fault == PY_NO_FAULT && {self.truth(node.test).at(AND)}) {{", node.body)
        return False

    def _do_For(self, node: ast.For) -> bool:
        call = node.iter
        if not (isinstance(call, ast.Call) and isinstance(call.func, ast.Name) and call.func.id == "range"):
            raise RefusedError("a loop must run over range(...)")
        if node.orelse or not isinstance(node.target, ast.Name) or not 1 <= len(call.args) <= 2:
            raise RefusedError(
                "a loop must be 'for name in range(stop)' or 'range(start, stop)', without else"
            )
        bounds = [self.number(a) for a in call.args]
        if any(b.kind is not WHOLE for b in bounds):
            raise RefusedError("range() takes whole numbers, such as int(n)")
        first = bounds[0].code if len(bounds) == 2 else "0"
        last = bounds[-1].code if bounds[-1].constant is not None else self.temporary(bounds[-1]).code
        self.temporaries += 1
        counter = f"py_{self.temporaries}"
        alive = "*py_fault == PY_NO_FAULT && " if self.fails_before else ""
        self.fails = self.fails or bool(alive)
        assign = ""
        name = node.target.id
        if name in self.loads:
            self.seen(name, WHOLE)
            if name not in self.env:
                self.late.append(name)
                self.env[name] = Value(c_name(name), self.kinds[name])
            assign = f"{c_name(name)} = {Value(counter, WHOLE).as_kind(self.kinds[name]).code};"
        head = f"for (int64_t {counter} = {first}; {alive}{counter} < {last}; {counter}++) {{"
        self.nested(head, node.body, assign)
        return False
