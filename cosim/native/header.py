"""The C text of a model: model.h, which the rest of the sources builds upon."""

from cosim.native import exchange
from cosim.native.glue import Glue
from cosim.native.kinds import c_name, real_text
from cosim.native.model import Model, buffers, inner_inputs, numbers, room


def header(model: Model, guid: str, fmi: str = "2.0") -> str:
    """Text of model.h: equations and tables of the model; `guid` is what the version `fmi` has an instance ask for."""
    return "\n".join(
        [
            f"/* {model.title}: equations translated from Python, and the tables of the FMU. Generated. */",
            "",
            *definitions(model, guid, fmi),
            "",
            *(part.program.text() for part in model.parts),
            *structs(model),
            *Glue(model).lines(),
            *exchange.lines(model),
            "",
        ]
    )


def array(kind: str, name: str, values: list[str]) -> str:
    """A constant table; C has no empty ones, so that an empty one gets an entry that nobody reads."""
    return f"static const {kind} {name}[] = {{{', '.join(values or ['0'])}}};"


def definitions(model: Model, guid: str, fmi: str) -> list[str]:
    """Names, bounds and start values."""
    names = [n for n, _, _ in model.rows]
    inner = [f"{p.name}.{n}" for p, n, _ in inner_inputs(model)]
    bounds = [v for _, _, v in inner_inputs(model)]
    kinds = {"input": "INPUT", "output": "OUTPUT", "parameter": "PARAMETER"}
    return [
        f"#define FMI_VERSION {fmi[0]}",
        f'#define MODEL_NAME "{model.name}"',
        guid_line(guid),
        f"#define N_INPUTS {len(model.of('input'))}",
        f"#define N_OUTPUTS {len(model.of('output'))}",
        f"#define N_VARIABLES {len(names)}",
        f"#define N_TABLES {len(model.tables)}",
        f"#define N_NUMBERS {sum(map(len, (numbers(p) for p in model.parts))) + sum(map(room, model.parts))}",
        f"#define TAKES_TIME {int(model.takes_time)}",
        f"#define DIRECT {int(any(model.is_direct(p.name, n) for p in model.parts for n in p.composed.direct))}",
        "",
        array("char *const", "model_names", [f'"{n}"' for n in names]),
        array("double", "model_starts", [real_text(float(model.starts.get(n, 0.0))) for n in names]),
        array("double", "model_lows", [real_text(float(v.low)) for _, _, v in model.rows]),
        array("double", "model_highs", [real_text(float(v.high)) for _, _, v in model.rows]),
        array("char", "model_integers", [str(int(v.kind == "integer")) for _, _, v in model.rows]),
        array("char", "model_kinds", [kinds[c] for _, c, _ in model.rows]),
        "enum { AT_END, AS_HELD, AT_START };",
        array("char", "model_reads", [read_as(model, n) for n, _ in model.of("input")]),
        array("char *const", "model_inner_names", [f'"{n}"' for n in inner]),
        array("double", "model_inner_lows", [real_text(float(v.low)) for v in bounds]),
        array("double", "model_inner_highs", [real_text(float(v.high)) for v in bounds]),
        array("char *const", "model_table_files", [f'"{f}"' for f, _ in model.tables]),
        array("int", "model_table_columns", [str(c) for _, c in model.tables]),
        *exchange.definitions(model),
    ]


def guid_line(guid: str) -> str:
    """The line that says what an instance is asked for."""
    return f'#define MODEL_GUID "{guid}"'


def read_as(model: Model, name: str) -> str:
    """What of an input that moves over a step the equations take: its end, the mean where they hold it, or its start.

    What feeds several components moves to its end for all of them, as under a master.
    """
    fed = [
        (model.part(w.target[0]).composed.block, w.target[1]) for w in model.wires if w.source == ("", name)
    ]
    ways = {block.reads.get(own) for block, own in fed}
    return "AS_HELD" if ways <= {"held"} else "AT_START" if ways == {"start"} else "AT_END"


def structs(model: Model) -> list[str]:
    """The struct of each component and of the whole."""
    lines = []
    for part in model.parts:
        prefix = part.program.prefix
        kinds = [("Parameters", "p"), ("Coefficients", "c"), ("State", "x"), ("Memory", "m")]
        lines += ["typedef struct {", *(f"    {prefix}{kind} {name};" for kind, name in kinds)]
        own = [
            f"    double {c_name(n)}[{b.length}];"
            for n, b in buffers(part.composed).items()
            if not b.resource
        ]
        lines += [*own, f"}} {prefix}Part;", ""]
    parts = [f"    {p.program.prefix}Part {c_name(p.name)};" for p in model.parts]
    tables = f"    py_array tables[{len(model.tables) or 1}];"
    return [
        *lines,
        "typedef struct {",
        *parts,
        tables,
        "    double refused; /* by an input within */",
        "} Model;",
        "",
    ]
