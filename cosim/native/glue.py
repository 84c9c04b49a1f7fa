"""The C functions between the FMI calls and the translated equations: initialisation, a step, saving and restoring."""

from cosim.native.kinds import c_name, real_text
from cosim.native.model import Model, Part, buffers, numbers

MOST_SWEEPS = 200  # as in cosim.master.engine


class Glue:
    """C text of the functions that `c/fmu.c` calls."""

    def __init__(self, model: Model) -> None:
        self.model = model
        self.output = {model.places[n]: k for k, (n, _) in enumerate(model.of("output"))}
        self.input = {n: k for k, (n, _) in enumerate(model.of("input"))}
        self.source = {w.target: w.source for w in model.wires}
        self.inner = {w.target: k for k, w in enumerate(w for w in model.wires if w.source[0])}

    def lines(self) -> list[str]:
        """All of them."""
        return [
            *self.link(),
            *self.parameters(),
            *self.coefficients(),
            *self.begin(),
            *self.step(),
            *self.direct(),
            *self.moves(),
        ]

    def link(self) -> list[str]:
        """Point the lists in the memory to where their numbers lie."""
        lines, k = [], 0
        for part in self.model.parts:
            own = c_name(part.name)
            for name, buffer in buffers(part.composed).items():
                place = f"M->{own}.m.{c_name(name)}"
                if buffer.resource:
                    lines.append(f"{place} = M->tables[{k}];")
                    k += 1
                else:
                    lines += [f"{place}.at = M->{own}.{c_name(name)};", f"{place}.length = {buffer.length};"]
        return function("model_link", "Model *M", lines or ["(void)M;"])

    def parameters(self) -> list[str]:
        """Take the parameters from the list of values."""
        lines = []
        for k, (name, _) in enumerate(self.model.of("parameter")):
            part, own = self.model.places[name]
            lines.append(f"M->{c_name(part)}.p.{c_name(own)} = values[{k}];")
        return function(
            "model_parameters", "Model *M, const double values[]", lines or ["(void)M;", "(void)values;"]
        )

    def coefficients(self) -> list[str]:
        """What depends on parameters and step size alone."""
        lines = []
        for part in self.model.parts:
            own = f"M->{c_name(part.name)}"
            lines.append(part.program.call("coefficients", f"{own}.c", f"&{own}.p", "h"))
        return function(
            "model_coefficients", "Model *M, double h, int *py_fault", [*lines, "(void)py_fault;"]
        )

    def arguments(self, part: Part, inputs: str, outputs: str) -> list[str]:
        """Declare the inputs `u` of a component; those that another component feeds are checked against their bounds."""
        values, checks = [], []
        composed = part.composed
        for name, variable in composed.block.inputs.items():
            if variable.kind == "time":
                values.append("now")
                continue
            source = self.source[part.name, name]
            values.append(
                f"{outputs}[{self.output[source]}]" if source[0] else f"{inputs}[{self.input[source[1]]}]"
            )
            if source[0]:
                k, low, high = self.inner[part.name, name], real_text(variable.low), real_text(variable.high)
                checks += [
                    f"if (!({low} <= u.{c_name(name)} && u.{c_name(name)} <= {high})) {{",
                    f"    M->refused = u.{c_name(name)};",
                    f"    py_raise(PY_REFUSED + {k}, py_fault);",
                    "    return;",
                    "}",
                ]
        layout = part.program.layouts["Input"].c
        return [f"const {layout} u = {{{', '.join(values) or '0'}}};", "(void)u;", *checks]

    def stores(self, part: Part) -> list[str]:
        """Put a component's outputs among those of the whole."""
        return [f"outputs[{self.output[part.name, n]}] = y.{c_name(n)};" for n in part.composed.outputs]

    def begin(self) -> list[str]:
        """State, memory and outputs at initialisation; in a loop of components until nothing moves any more."""
        lines = [line for name in self.model.begin for line in self.begin_part(self.model.part(name))]
        head = "Model *M, const double inputs[], double outputs[], double now, int *py_fault"
        given = ["(void)inputs;", "(void)now;", "(void)py_fault;"]
        if not self.model.loop:
            return function("model_begin", head, [*given, *lines])
        sweeps = [
            "double before[N_OUTPUTS], scale[N_OUTPUTS] = {0};",
            "int sweep, k, moving = 1;",
            "memset(outputs, 0, N_OUTPUTS * sizeof *outputs);",
            f"for (sweep = 0; moving && sweep < {MOST_SWEEPS}; sweep++) {{",
            "    memcpy(before, outputs, sizeof before);",
            "    model_sweep(M, inputs, outputs, now, py_fault);",
            "    for (k = 0, moving = 0; k < N_OUTPUTS; k++) {",
            "        scale[k] = py_max(scale[k], fabs(outputs[k]));",
            "        moving = moving || !(fabs(outputs[k] - before[k]) <= 1e-13 * scale[k]);",
            "    }",
            "}",
            "if (moving) {",
            "    py_raise(PY_UNSETTLED, py_fault);",
            "}",
            "model_sweep(M, inputs, outputs, now, py_fault);",
        ]
        return [*function("model_sweep", head, [*given, *lines]), *function("model_begin", head, sweeps)]

    def begin_part(self, part: Part) -> list[str]:
        """One component at initialisation."""
        own, program = f"M->{c_name(part.name)}", part.program
        lists = [f"{own}.m.{c_name(n)}" for n in buffers(part.composed)]
        lines = self.arguments(part, "inputs", "outputs")
        lines += [f"{program.layouts['Output'].c} y;"]
        if lists:
            # one by one: tcc takes no structs among the initial values of an array
            lines.append(f"py_array buffers[{len(lists)}];")
            lines += [f"buffers[{k}] = {name};" for k, name in enumerate(lists)]
        for name, buffer in buffers(part.composed).items():
            if not buffer.resource:
                lines.append(f"memset({own}.{c_name(name)}, 0, sizeof {own}.{c_name(name)});")
        lines += [
            program.call("start", f"{own}.x", "&u", f"&{own}.p"),
            program.call("begin", f"{own}.m", f"&{own}.x", "&u", f"&{own}.p", "buffers" if lists else "0"),
            program.call("output", "y", f"&{own}.x", "&u", f"&{own}.m", f"&{own}.p"),
            *self.stores(part),
        ]
        return ["{", *(f"    {line}" for line in lines), "}"]

    def step(self) -> list[str]:
        """A step of every component, each with what its sources just computed; after a fault nothing is stored."""
        lines = ["(void)inputs;", "(void)now;", "(void)py_fault;"]
        for part in self.model.parts:
            own, program = f"M->{c_name(part.name)}", part.program
            names = [f"{own}.{n}" for n in "xm"]
            inner = [
                *self.arguments(part, "inputs", "outputs"),
                f"{program.entries['advance'].result.c} next;",
                f"{program.layouts['Output'].c} y;",
                program.call("advance", "next", *(f"&{n}" for n in names), "&u", f"&{own}.p", f"&{own}.c"),
                program.call("output", "y", "&next.e0", "&u", "&next.e1", f"&{own}.p"),
                "if (*py_fault != PY_NO_FAULT) {",
                "    return;",
                "}",
                f"{own}.x = next.e0;",
                f"{own}.m = next.e1;",
                *self.stores(part),
            ]
            lines += ["{", *(f"    {line}" for line in inner), "}"]
        return function(
            "model_step",
            "Model *M, const double inputs[], double outputs[], double now, int *py_fault",
            lines,
        )

    def direct(self) -> list[str]:
        """Outputs that follow the inputs at once, by a step of length 0 of their components, of which nothing is kept."""
        lines = []
        for part in self.model.parts:
            names = [n for n in part.composed.direct if self.model.is_direct(part.name, n)]
            if not names:
                continue
            own, program = f"M->{c_name(part.name)}", part.program
            inner = [
                *self.arguments(part, "inputs", "outputs"),
                f"{program.layouts['Coefficients'].c} c;",
                f"{program.entries['advance'].result.c} next;",
                f"{program.layouts['Output'].c} y;",
                program.call("coefficients", "c", f"&{own}.p", "0.0"),
                program.call("advance", "next", f"&{own}.x", f"&{own}.m", "&u", f"&{own}.p", "&c"),
                program.call("output", "y", "&next.e0", "&u", "&next.e1", f"&{own}.p"),
                "(void)c;",
                "if (*py_fault != PY_NO_FAULT) {",
                "    return;",
                "}",
            ]
            for name in names:
                value, place = f"y.{c_name(name)}", f"outputs[{self.output[part.name, name]}]"
                inner.append(f"{place} = -1e300 < {value} && {value} < 1e300 ? {value} : {place};")
            lines += ["{", *(f"    {line}" for line in inner), "}"]
        head = "Model *M, const double inputs[], double outputs[], int *py_fault"
        return function("model_direct", head, lines) if lines else []

    def moves(self) -> list[str]:
        """All numbers of state and memory into a list, and back."""
        out, back = [], []
        for part in self.model.parts:
            own = f"M->{c_name(part.name)}"
            for place in numbers(part):
                out.append(f"*to++ = {own}.{place};")
                back.append(f"{own}.{place} = *from++;")
            for name, buffer in buffers(part.composed).items():
                if not buffer.resource:
                    place = f"{own}.{c_name(name)}"
                    out += [f"memcpy(to, {place}, sizeof {place});", f"to += {buffer.length};"]
                    back += [f"memcpy({place}, from, sizeof {place});", f"from += {buffer.length};"]
        return [
            *function("model_save", "const Model *M, double *to", [*out, "(void)to;"]),
            *function("model_load", "Model *M, const double *from", [*back, "(void)from;"]),
        ]


def function(name: str, arguments: str, lines: list[str]) -> list[str]:
    """A static function."""
    return [f"static void {name}({arguments}) {{", *(f"    {line}" for line in lines), "}", ""]
