"""Runs an exported package of plain Modelica without a Modelica tool: pymoca parses, what follows checks and evaluates.

No tool on PyPI simulates it (Rumoca 0.10 and modelica 0.0.205 know no functions with loops that end early). So functions
are checked against the types of their declarations on every path, each expression, and become Python; models are evaluated
by data flow, as a tool does at an event: each equation once what it needs is known, `pre` as at the event before.
"""

import math
from pathlib import Path

from pymoca import ast, parser

NUMBERS = ("Integer", "Real")
RELATIONS = ("<", "<=", ">", ">=", "==", "<>")
BUILT_IN = {
    "abs": "same", "min": "same", "max": "same", "mod": "same", "integer": "Integer", "floor": "Real", "ceil": "Real",
} | dict.fromkeys(
    ("sin", "cos", "tan", "asin", "acos", "atan", "atan2", "sinh", "cosh", "tanh", "exp", "log", "sqrt"), "Real"
)  # fmt: skip
WORLD = {n: getattr(math, n) for n, kind in BUILT_IN.items() if hasattr(math, n) and kind == "Real"} | {
    "abs": abs, "min": min, "max": max, "integer": math.floor, "floor": lambda x: float(math.floor(x)),
    "ceil": lambda x: float(math.ceil(x)), "mod": lambda x, y: x - math.floor(x / y) * y, "pow": math.pow,
}  # fmt: skip


class TypeFaultError(Exception):
    """The package breaks a rule of Modelica."""


def parts(reference):
    """Names of a component reference, with the subscript of each or None."""
    found = []
    while reference is not None:
        subscripts = [i for row in reference.indices for i in row if i is not None]
        found.append((reference.name, subscripts[0] if subscripts else None))
        reference = reference.child[0] if reference.child else None
    return found


def dotted(reference):
    return ".".join(name for name, _ in parts(reference)) if not isinstance(reference, str) else reference


class Package:
    """A parsed package; functions as Python in `world`."""

    def __init__(self, text):
        tree = parser.parse(text)
        if tree is None:
            raise TypeFaultError("pymoca cannot parse it")
        self.root = list(tree.classes.values())[-1]
        self.world = dict(WORLD, element=element)
        self.compiled = {}
        self.constants = {
            n: symbol_value(s).value for n, s in self.root.symbols.items() if "constant" in s.prefixes
        }

    def find(self, name, scope):
        """A class by name, looked up from the class `scope` outwards, with its full name."""
        first, *rest = name.split(".")
        while scope is not None:
            if first in scope.classes:
                found = scope.classes[first]
                for more in rest:
                    if more not in found.classes:
                        raise TypeFaultError(f"there is no {name}")
                    found = found.classes[more]
                return found
            scope = scope.parent if isinstance(scope.parent, ast.Class) else None
        raise TypeFaultError(f"there is no {name}")

    def record_type(self, symbol, scope):
        """Type of a declared variable: a name, a record's class, or ("array", length)."""
        name = dotted(symbol.type)
        size = symbol.dimensions[0][0]
        if getattr(size, "value", None) is not None:
            if name != "Real":
                raise TypeFaultError(f"a list of {name}")
            return ("array", size.value)
        return name if name in (*NUMBERS, "Boolean") else self.find(name, scope)

    def function(self, name, scope):
        """The function or record constructor of a name: Python's name, inputs and outputs as (name, type)."""
        found = self.find(name, scope)
        if id(found) in self.compiled:
            return self.compiled[id(found)]
        fields = [(n, self.record_type(s, found)) for n, s in found.symbols.items()]
        python = f"f{len(self.compiled)}_{found.name}"
        if found.type == "record":
            self.compiled[id(found)] = python, fields, [("", found)]
            self.world[python] = lambda *values: values
            return self.compiled[id(found)]
        if found.type != "function":
            raise TypeFaultError(f"{name} is no function")
        ways = {
            n: next((p for p in s.prefixes if p in ("input", "output")), "") for n, s in found.symbols.items()
        }
        signature = tuple([(n, t) for n, t in fields if ways[n] == way] for way in ("input", "output"))
        self.compiled[id(found)] = (python, *signature)
        _Function(self, found, dict(fields), ways, python)
        return self.compiled[id(found)]

    def check(self):
        """Compile every function, called or not; how many there are."""
        seen = [self.root]
        for scope in seen:
            seen += scope.classes.values()
            if scope.type == "function":
                self.function(scope.name, scope.parent)
        return len([s for s in seen if s.type == "function"])


def symbol_value(symbol):
    """The declared value of a variable."""
    for argument in symbol.class_modification.arguments if symbol.class_modification else []:
        if argument.value.component.name == "value":
            return argument.value.modifications[0]
    return None


def element(x, i):
    if not 1 <= i <= len(x):
        raise IndexError(i)
    return x[i - 1]


def fits(given, wanted):
    return given == wanted or (given == "Integer" and wanted == "Real")


class _Expressions:
    """Python text and type of an expression."""

    def reference(self, node):
        raise NotImplementedError

    def number(self, node):
        text, kind = self.of(node)
        if kind not in NUMBERS:
            raise TypeFaultError(f"{node} is {kind}, no number")
        return text, kind

    def truth(self, node):
        text, kind = self.of(node)
        if kind != "Boolean":
            raise TypeFaultError(f"{node} is {kind}, no condition")
        return text

    def of(self, node):
        if isinstance(node, ast.Primary):
            value = node.value
            kinds = {bool: "Boolean", int: "Integer", float: "Real"}
            if type(value) not in kinds:
                raise TypeFaultError(f"the constant {value!r}")
            return repr(value), kinds[type(value)]
        if isinstance(node, ast.ComponentRef):
            return self.reference(node)
        if isinstance(node, ast.IfExpression):
            tests = [self.truth(c) for c in node.conditions]
            values = [self.of(e) for e in node.expressions]
            kinds = {k for _, k in values}
            if len(kinds) > 1 and not kinds <= set(NUMBERS):
                raise TypeFaultError(f"{node} gives {kinds}")
            text = values[-1][0]
            for test, (value, _) in zip(reversed(tests), reversed(values[:-1]), strict=True):
                text = f"({value} if {test} else {text})"
            return text, values[0][1] if len(kinds) == 1 else "Real"
        if not isinstance(node, ast.Expression):
            raise TypeFaultError(f"{type(node).__name__} in an expression")
        return self.operation(node)

    def operation(self, node):
        operator = dotted(node.operator)
        operands = node.operands
        if operator in ("and", "or"):
            return f"({f' {operator} '.join(self.truth(o) for o in operands)})", "Boolean"
        if operator == "not":
            return f"(not {self.truth(operands[0])})", "Boolean"
        if operator in RELATIONS:
            one, other = (self.number(o)[0] for o in operands)
            return f"({one} {'!=' if operator == '<>' else operator} {other})", "Boolean"
        if operator in ("+", "-", "*", "/", "^"):
            texts = [self.number(o) for o in operands]
            kind = "Real" if operator in "/^" or "Real" in [k for _, k in texts] else "Integer"
            if operator == "^":
                return f"pow({texts[0][0]}, {texts[1][0]})", kind
            if len(texts) == 1:
                return f"({operator}{texts[0][0]})", kind
            return f"({texts[0][0]} {operator} {texts[1][0]})", kind
        if operator == "size":
            _, kind = self.of(operands[0])
            return str(kind[1]), "Integer"
        if operator == "fill":
            return f"({self.number(operands[0])[0]},) * {operands[1].value}", ("array", operands[1].value)
        if operator in BUILT_IN:
            texts = [self.number(o) for o in operands]
            if len(texts) != (2 if operator in ("min", "max", "mod", "atan2") else 1):
                raise TypeFaultError(f"{node}: {len(texts)} arguments")
            same = "Real" if "Real" in [k for _, k in texts] else "Integer"
            kind = BUILT_IN[operator]
            return f"{operator}({', '.join(t for t, _ in texts)})", same if kind == "same" else kind
        text, outputs = self.call(node)
        if len(outputs) != 1:
            raise TypeFaultError(f"{operator} has {len(outputs)} results within an expression")
        return text, outputs[0][1]

    def call(self, node):
        """A call of a function of the package, and its outputs."""
        python, inputs, outputs = self.package.function(dotted(node.operator), self.scope)
        if len(inputs) != len(node.operands):
            raise TypeFaultError(
                f"{dotted(node.operator)} takes {len(inputs)} arguments, not {len(node.operands)}"
            )
        texts = []
        for (name, wanted), operand in zip(inputs, node.operands, strict=True):
            text, given = self.of(operand)
            if not fits(given, wanted):
                raise TypeFaultError(f"{dotted(node.operator)}: {name} is {wanted}, not {given}")
            texts.append(text)
        return f"{python}({', '.join(texts)})", outputs


def reached(package, kind, rest, text, expressions):
    """What a path of fields and subscripts leads to."""
    for name, subscript in rest:
        if not isinstance(kind, ast.Class) or name not in kind.symbols:
            raise TypeFaultError(f"{kind} has no field {name}")
        text = f"{text}[{list(kind.symbols).index(name)}]"
        kind = package.record_type(kind.symbols[name], kind)
        text, kind = indexed(text, kind, subscript, expressions)
    return text, kind


def indexed(text, kind, subscript, expressions):
    if subscript is None or getattr(subscript, "value", 1) is None:
        return text, kind
    place, whole = expressions.of(subscript)
    if whole != "Integer" or kind[0] != "array":
        raise TypeFaultError(f"{text}[{subscript}]")
    return f"element({text}, {place})", "Real"


class _Function(_Expressions):
    """A function as Python."""

    def __init__(self, package, scope, kinds, ways, python):
        self.package, self.scope, self.kinds, self.ways = package, scope, kinds, ways
        self.iterators, self.lines, self.indent = [], [], "    "
        outputs = [n for n, w in ways.items() if w == "output"]
        self.give = f"return {', '.join(f'v_{n}' for n in outputs)}"
        self.block(scope.statements)
        inputs = ", ".join(f"v_{n}" for n, w in ways.items() if w == "input")
        lines = [f"def {python}({inputs}):", *self.lines, f"    {self.give}"]
        exec("\n".join(lines), package.world)

    def reference(self, node):
        (name, subscript), *rest = parts(node)
        if name in self.iterators:
            return f"v_{name}", "Integer"
        if name not in self.kinds:
            raise TypeFaultError(f"{self.scope.name}: there is no {name}")
        text, kind = indexed(f"v_{name}", self.kinds[name], subscript, self)
        return reached(self.package, kind, rest, text, self)

    def line(self, text):
        self.lines.append(self.indent + text)

    def block(self, statements):
        for statement in statements:
            getattr(self, f"on_{type(statement).__name__}")(statement)

    def nested(self, statements):
        self.indent += "    "
        before = len(self.lines)
        self.block(statements)
        if len(self.lines) == before:
            self.line("pass")
        self.indent = self.indent[:-4]

    def on_Primary(self, node):
        self.line({"return": self.give, "break": "break"}[node.value])

    def target(self, node, kind):
        """Where a value of a type goes."""
        name = node.name
        if self.ways.get(name) == "input" or name in self.iterators:
            raise TypeFaultError(f"{self.scope.name} assigns to {name}")
        _, wanted = self.reference(node)
        if not fits(kind, wanted):
            raise TypeFaultError(f"{self.scope.name}: {node} is {wanted}, not {kind}")

    def on_AssignmentStatement(self, node):
        left = node.left
        if len(left) == 1 and left[0] is not None and not self.is_function(node.right):
            text, kind = self.of(node.right)
            self.target(left[0], kind)
            path = parts(left[0])
            if len(path) == 1:
                self.line(f"v_{path[0][0]} = {text}")
            else:  # an element of a list in a record
                (name, _), (field, subscript) = path
                record = self.kinds[name]
                k, place = list(record.symbols).index(field), self.of(subscript)[0]
                self.line(f"place, content = {place}, list(v_{name}[{k}])")
                self.line("element(content, place)")
                self.line(f"content[place - 1] = {text}")
                self.line(f"v_{name} = (*v_{name}[:{k}], tuple(content), *v_{name}[{k + 1}:])")
            return
        text, outputs = self.call(node.right)
        if len(left) > len(outputs):
            raise TypeFaultError(f"{self.scope.name}: {len(outputs)} results for {len(left)} variables")
        names = []
        for variable, (_, kind) in zip(left, outputs, strict=False):
            if variable is not None:
                self.target(variable, kind)
            names.append("_" if variable is None else f"v_{variable.name}")
        names += ["_"] * (len(outputs) - len(left))
        self.line(f"{', '.join(names)} = {text}")

    def is_function(self, node):
        if not isinstance(node, ast.Expression) or dotted(node.operator) in BUILT_IN:
            return False
        return dotted(node.operator)[0].isalpha() and len(self.outputs_of(node)) > 1

    def outputs_of(self, node):
        name = dotted(node.operator)
        return (
            [] if name in ("and", "or", "not", "size", "fill") else self.package.function(name, self.scope)[2]
        )

    def on_IfStatement(self, node):
        for k, block in enumerate(node.blocks):
            known = k < len(node.conditions) and node.conditions[k] is not True
            head = f"{'el' if k else ''}if {self.truth(node.conditions[k])}:" if known else "else:"
            self.line(head)
            self.nested(block)

    def on_WhileStatement(self, node):
        self.line(f"while {self.truth(node.condition)}:")
        self.nested(node.statements)

    def on_ForStatement(self, node):
        [index] = node.indices
        first, last = (self.of(e) for e in (index.expression.start, index.expression.stop))
        if (first[1], last[1]) != ("Integer", "Integer"):
            raise TypeFaultError(f"{self.scope.name}: a loop over {index.expression}")
        self.iterators.append(index.name)
        self.line(f"for v_{index.name} in range({first[0]}, {last[0]} + 1):")
        self.nested(node.statements)
        self.iterators.pop()


class Instance(_Expressions):
    """A component: its variables, and equations that are evaluated when somebody asks for what they give."""

    def __init__(self, package, scope, given, folder, source=None):
        self.package, self.scope, self.folder, self.source = package, scope, folder, source or {}
        self.now, self.old, self.time, self.open = {}, {}, 0.0, set()
        self.kinds, self.tables = {}, {}
        self.wired = {}
        for name, symbol in scope.symbols.items():
            kind = dotted(symbol.type)
            if kind.startswith("Modelica.Blocks.Sources"):
                self.tables[name] = table_of(symbol, folder)
            elif kind.startswith("Modelica."):
                self.kinds[name] = "Real"
            else:
                self.kinds[name] = package.record_type(symbol, scope)
        self.parameters = {}
        for name, symbol in scope.symbols.items():
            if "parameter" in symbol.prefixes:
                value = symbol_value(symbol)
                text, kind = self.of(value)
                if not fits(kind, self.kinds[name]):
                    raise TypeFaultError(f"{scope.name}.{name} is {self.kinds[name]}, not {kind}")
                found = given[name] if name in given else self.evaluated(text)
                self.parameters[name] = found
        unknown = set(given) - set(self.parameters)
        if unknown:
            raise TypeFaultError(f"{scope.name} has no parameters {sorted(unknown)}")
        whens = [e for e in scope.equations if isinstance(e, ast.WhenEquation)]
        plain = [e for e in scope.equations if isinstance(e, ast.Equation)]
        self.phases = {
            True: self.giving([*scope.initial_equations, *plain]),
            False: self.giving([*(e for w in whens for e in w.blocks[0]), *plain]),
        }

    def giving(self, equations):
        """Equation by the variable that it gives: names, types checked, and compiled right side."""
        found = {}
        for equation in equations:
            left = equation.left if isinstance(equation.left, list) else [equation.left]
            if len(left) > 1:
                text, outputs = self.call(equation.right)
                kinds = [k for _, k in outputs]
            else:
                text, kind = self.of(equation.right)
                kinds = [kind]
            names = [variable.name for variable in left]
            if len(names) != len(kinds) or not all(
                fits(k, self.kinds[n]) for n, k in zip(names, kinds, strict=True)
            ):
                raise TypeFaultError(f"{self.scope.name}: {names} = {kinds}")
            code = compile(text, self.scope.name, "eval")
            for name in names:
                if name in found:
                    raise TypeFaultError(f"{self.scope.name}: {name} is given twice")
                found[name] = names, code
        return found

    def reference(self, node):
        (name, _), *rest = parts(node)
        if name == "time":
            return "me.time", "Real"
        if name in self.package.constants and name not in self.kinds:
            return repr(self.package.constants[name]), "Real"
        if name in self.tables:
            return f"me.tables[{name!r}](me.time, me.parameters)", "Real"
        if name not in self.kinds:
            raise TypeFaultError(f"{self.scope.name}: there is no {name}")
        return reached(self.package, self.kinds[name], rest, f"me.value({name!r})", self)

    def operation(self, node):
        if dotted(node.operator) == "pre":
            name = node.operands[0].name
            return f"me.old[{name!r}]", self.kinds[name]
        return super().operation(node)

    def evaluated(self, code):
        return eval(code, {**self.package.world, "me": self})

    def begin_event(self, time, initial):
        self.old, self.now, self.time, self.initial = self.now, {}, time, initial

    def value(self, name):
        """The value of a variable now."""
        if name in self.parameters:
            return self.parameters[name]
        if name not in self.now:
            if name in self.open:
                raise TypeFaultError(f"{self.scope.name}.{name} depends on itself")
            self.open.add(name)
            if name in self.wired:
                self.now[name] = self.wired[name]()
            elif name in self.phases[self.initial]:
                names, code = self.phases[self.initial][name]
                values = eval(code, {**self.package.world, "me": self})
                self.now.update(zip(names, values, strict=True) if len(names) > 1 else [(names[0], values)])
            else:
                raise TypeFaultError(f"nothing gives {self.scope.name}.{name}")
            self.open.discard(name)
        return self.now[name]


def table_of(symbol, folder):
    """A CombiTimeTable that plays a file."""
    given = {a.value.component.name: a.value.modifications[0] for a in symbol.class_modification.arguments}
    [uri] = [o.value for o in given["fileName"].operands]
    file = folder / uri.partition("://")[2].partition("/")[2]
    lines = file.read_text().splitlines()
    assert lines[2] == f"double {given['tableName'].value}({len(lines) - 3}, 2)"
    rows = [tuple(map(float, line.split())) for line in lines[3:]]

    def value(time, parameters):
        held = parameters["hold"] == 1
        now = time + (1e-9 if held else 0.0)  # shiftTime
        k = max((i for i, row in enumerate(rows) if row[0] <= now), default=0)
        if held or k + 1 == len(rows) or now < rows[0][0]:
            return rows[k][1]
        return rows[k][1] + (now - rows[k][0]) / (rows[k + 1][0] - rows[k][0]) * (rows[k + 1][1] - rows[k][1])

    return value


class System:
    """The model `System` of a package, or one block of it alone.

    Args:
        file: package.mo.
        values: parameters of the components that differ, by (component, name).
        inputs: of an open system: function of time by name.
    """

    def __init__(self, package, file, values=None, inputs=None):
        self.package = package
        scope = package.root.classes["System"]
        self.instances = {}
        self.inputs = inputs or {}
        for name, symbol in scope.symbols.items():
            if dotted(symbol.type).startswith("Modelica."):
                continue
            arguments = symbol.class_modification.arguments if symbol.class_modification else []
            given = {a.value.component.name: self.plain(a.value.modifications[0]) for a in arguments}
            given |= {n: v for (c, n), v in (values or {}).items() if c == name}
            kind = package.find(dotted(symbol.type), scope)
            self.instances[name] = Instance(package, kind, given, file.parent)
        for equation in scope.equations:
            self.wire(equation)

    def plain(self, node):
        if isinstance(node, ast.Expression):
            return -node.operands[0].value
        return node.value

    def wire(self, equation):
        one, other = [n for n, _ in parts(equation.left)], [n for n, _ in parts(equation.right)]
        target = self.instances[other[0]]
        if len(one) == 1:
            target.wired[other[1]] = lambda: self.inputs[one[0]](self.time)
        else:
            source = self.instances[one[0]]
            for owner, variable in ((source, one[1]), (target, other[1])):
                if variable not in owner.kinds:
                    raise TypeFaultError(f"there is no {owner.scope.name}.{variable}")
            target.wired[other[1]] = lambda: source.value(one[1])

    def event(self, time, initial=False):
        """Evaluate everything at an instant."""
        self.time = time
        for instance in self.instances.values():
            instance.begin_event(time, initial)
        for instance in self.instances.values():
            for name in instance.phases[initial]:
                instance.value(name)

    def run(self, steps, h):
        """Every output of every component at each instant: name -> list."""
        outputs = [
            (c, n)
            for c, instance in self.instances.items()
            for n, s in instance.scope.symbols.items()
            if dotted(s.type).endswith("RealOutput") and not c.endswith("_hold")
        ]
        found = {f"{c}.{n}": [] for c, n in outputs}
        for k in range(steps + 1):
            self.event(k * h, k == 0)
            for c, n in outputs:
                found[f"{c}.{n}"].append(self.instances[c].value(n))
        return found


def read(file):
    """The package of a file."""
    return Package(Path(file).read_text())
