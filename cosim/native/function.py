"""One equation as a C function: its statements, its variables and what it returns."""

import ast
from collections import Counter
from collections.abc import Callable, Sequence

from cosim.native.expressions import RefusedError
from cosim.native.kinds import NONE, REAL, TRUTH, WHOLE, Kind, Struct, Value, c_name
from cosim.native.statements import Statements

NOTHING = {REAL: " = 0.0", WHOLE: " = 0", TRUTH: " = 0"}  # before the first assignment
PASSES = 12  # kinds settle in two or three


class Function(Statements):
    """A function of the composed text for arguments of given kinds.

    Attributes:
        name: of the C function.
        result: kind of what it returns.
        used: parameters that its C form has: structs that nobody looks at are left out.
        lines: C text of its body.
    """

    def __init__(
        self,
        node: ast.FunctionDef,
        kinds: Sequence[Kind],
        name: str,
        layouts: dict[str, Struct],
        tuples: Callable[[tuple[Kind, ...]], Struct],
        find: Callable[[str, tuple[Kind, ...]], "Function"],
        with_rates: bool = False,
    ) -> None:
        """Translate.

        Raises:
            RefusedError: a statement has no translation; the text quotes it.
        """
        arguments = node.args
        if arguments.vararg or arguments.kwarg or arguments.kwonlyargs or arguments.defaults:
            raise RefusedError("arguments with stars, defaults or keywords are not supported")
        if len(arguments.args) != len(kinds):
            raise RefusedError(f"it takes {len(arguments.args)} arguments, not {len(kinds)}")
        self.node, self.name, self.layouts, self.tuples, self.find = node, name, layouts, tuples, find
        self.with_rates = with_rates
        self.parameters = dict(zip((a.arg for a in arguments.args), kinds, strict=True))
        self.body = node.body[1:] if ast.get_docstring(node) else node.body
        nodes = [n for statement in self.body for n in ast.walk(statement) if isinstance(n, ast.Name)]
        self.stores = Counter(n.id for n in nodes if isinstance(n.ctx, ast.Store))
        self.stores.update({
            n.target.id: 1 for s in self.body for n in ast.walk(s)
            if isinstance(n, ast.AugAssign) and isinstance(n.target, ast.Name)
        })  # fmt: skip
        self.loads = {n.id for n in nodes if isinstance(n.ctx, ast.Load)} | {
            n.target.id for s in self.body for n in ast.walk(s)
            if isinstance(n, ast.AugAssign) and isinstance(n.target, ast.Name)
        }  # fmt: skip
        self.kinds: dict[str, Kind] = dict(self.parameters)
        self.result: Kind = NONE
        self.fails = False
        self.used: set[str] = set()
        for _ in range(PASSES):
            known = dict(self.kinds), self.result, self.fails, set(self.used)
            self.translate()
            if known == (self.kinds, self.result, self.fails, self.used):
                break
        else:
            raise RefusedError("the kinds of its variables do not settle")

    # As its callers see it

    def arguments(self, given: Sequence[Value]) -> list[str]:
        """C texts of the arguments; a struct is handed on by address."""
        texts = []
        for (name, kind), value in zip(self.parameters.items(), given, strict=True):
            if not isinstance(kind, Struct):
                texts.append(value.code)
            elif name in self.used:
                if not (value.pointer or value.code.isidentifier() or value.code.startswith("PY_NEW(")):
                    raise RefusedError(
                        f"the tuple that a call gives cannot be handed on as '{name}': give it a name first"
                    )
                texts.append(value.code if value.pointer else f"&{value.code}")
        return texts

    def text(self) -> str:
        """The C function."""
        return "\n".join([f"{self.head()} {{", *(f"    {line}" for line in self.lines), "}"])

    def head(self) -> str:
        """Its declaration."""
        listed = []
        for name, kind in self.parameters.items():
            given = self.given(name)
            if isinstance(kind, Struct):
                if name in self.used:
                    listed.append(f"const {kind.c} *{given}")
            else:
                listed.append(f"{kind.c}{'' if kind.c.endswith('*') else ' '}{given}")
        if self.fails:
            listed.append("int *py_fault")
        return f"static {self.result.c} {self.name}({', '.join(listed) or 'void'})"

    def given(self, name: str) -> str:
        """Name of a parameter in C: another one if the function assigns to it in a way that needs a copy."""
        return f"given_{name}" if self.copied(name) else c_name(name)

    def copied(self, name: str) -> bool:
        """True if an assignment to a parameter needs a variable of its own."""
        kind = self.parameters[name]
        return self.stores[name] > 0 and (isinstance(kind, Struct) or self.kinds[name] != kind)

    # One pass over the body

    def translate(self) -> None:
        """Go through the body with the kinds known so far."""
        self.lines: list[str] = []
        self.indent = ""
        self.depth = 0
        self.temporaries = 0
        self.env: dict[str, Value] = {}
        self.late: list[str] = []  # variables that a nested block assigns first: declared at the top
        self.fails_before, self.fails = self.fails, False
        self.used = set()
        for name, kind in self.parameters.items():
            if self.copied(name):
                value = Value(f"given_{name}", kind, pointer=isinstance(kind, Struct))
                self.seen(name, kind)
                text = f"*{value.code}" if value.pointer else value.as_kind(self.kinds[name]).code
                self.used.add(name)
                self.line(f"{self.kinds[name].c} {c_name(name)} = {text};")
                self.env[name] = Value(c_name(name), self.kinds[name])
            else:
                self.env[name] = Value(c_name(name), kind, pointer=isinstance(kind, Struct))
        ends = self.block(self.body)
        if self.result is not NONE and not ends:
            raise RefusedError("it may end without returning a value")
        top = [f"{self.kinds[n].c} {c_name(n)}{NOTHING.get(self.kinds[n], '')};" for n in self.late]
        idle = [n for n, k in self.parameters.items() if not isinstance(k, Struct) and n not in self.used]
        self.lines = [*top, *(f"(void){self.given(n)};" for n in idle), *self.lines]

    def _on_Name(self, node: ast.Name) -> Value:
        self.used.add(node.id)
        return super()._on_Name(node)

    def of_function(self, name: str, arguments: Sequence[ast.expr]) -> Value:
        """A call of another equation; a struct that it does not look at is not used here either."""
        given, touched = [], []
        before = self.used
        for argument in arguments:
            self.used = set()
            given.append(self.expression(argument))
            touched.append(self.used)
        self.used = before
        callee = self.find(name, tuple(v.kind for v in given))
        for k, names in enumerate(touched):
            if not callee.leaves_out(k):
                self.used |= names
        texts = callee.arguments(given)
        if callee.fails:
            return Value(self.failing(callee.name, *texts), callee.result)
        return Value(f"{callee.name}({', '.join(texts)})", callee.result)

    def leaves_out(self, k: int) -> bool:
        """True if the C form does not have parameter number `k`."""
        name, kind = list(self.parameters.items())[k]
        return isinstance(kind, Struct) and name not in self.used
