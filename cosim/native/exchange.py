"""Model exchange: the derivatives of a block's states, from its own step.

A block's file says how a step of length h changes its state. The derivative of that by h at h = 0 is the right-hand side of
the block's differential equation; numbers that carry a derivative give it exactly (`c/rates.h`). A first step of length 0
brings what a state keeps of its input (an opening, a torque) up to date.

What is sampled (a table, a controller, an observer) and a whole chain make a step of co-simulation every millisecond, at an
event whose time the host is told.

A block with events (a stop, dry friction) says besides how a step goes on in which none comes (`step_without_event`), what
tells that one has come (`indicators`), the state after it (`after_event`) and the motion that begins there (`motion_from`).
Where an effect of a block with differential equations remembers the past, the effect is refused.
"""

import hashlib
import uuid
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import get_args

from lxml import etree
from lxml.builder import E

from cosim.native.glue import function
from cosim.native.kinds import REAL, c_name, real_text
from cosim.native.model import Model, Part, buffers
from cosim.native.translate import CO_SIMULATION, Program, program_of
from cosim.units import base_exponents
from fmus.contract import Variable
from fmus.dependencies import after_step, at_start, of_states
from fmus.describe import scalar_variable, unit_definitions, unknown


@dataclass(frozen=True)
class Exchange:
    """What model exchange of a block needs.

    Attributes:
        states: its continuous states, each with the states and inputs on which its derivative depends; the other fields of
            `State` follow from the input.
        smooth: parameters that must be zero: their effect has a state of its own, or jumps as often as a reading does.
    """

    states: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    smooth: tuple[str, ...] = ()


EXCHANGE = {
    "dead_zone": Exchange(),
    "sensor": Exchange({}, ("quantum",)),
    "continuity": Exchange({"p_load": ("p_load", "spool")}),
    "continuity_physical": Exchange(
        {
            "p_a": ("p_a", "p_b", "p_supply", "rack", "spool", "omega"),
            "p_b": ("p_a", "p_b", "p_supply", "rack", "spool", "omega"),
            "p_supply": ("p_a", "p_b", "p_supply", "spool"),
            "rack": ("omega",),
        }
    ),
    "mechanical": Exchange({"theta": ("theta", "omega"), "omega": ("theta", "omega", "p_load")}, ("z_s",)),
    "simplified": Exchange({"theta": ("omega",), "omega": ("omega", "command")}),
    "dcv": Exchange({"spool": ("spool_rate",), "spool_rate": ("spool", "spool_rate", "demand")}),
}
MOVING = ("State", "Input", "Memory", "Parameters", "Coefficients")
EVENTS = {
    "coefficients": CO_SIMULATION["coefficients"],
    "motion_from": MOVING,
    "after_event": (*MOVING, REAL),
    "indicators": (*MOVING, REAL),
}


def exchange(model: Model) -> Exchange | None:
    """How a model is exchanged by its differential equations; None if it is sampled."""
    return EXCHANGE.get(model.parts[0].composed.block.name) if len(model.parts) == 1 else None


def indicators(model: Model) -> int:
    """How many numbers tell that an event has come."""
    found = exchange(model)
    made = getattr(model.parts[0].composed.block.module, "indicators", None) if found else None
    return len(get_args(made.__annotations__["return"])) if made else 0


def states(model: Model) -> list[tuple[str, Variable]]:
    """The continuous states, named x.name."""
    found = exchange(model)
    if found is None:
        return []
    known = model.parts[0].composed.block.states
    return [(f"x.{n}", replace(known[n], text=f"State: {known[n].text}")) for n in found.states]


def derivative_of(variable: Variable) -> Variable:
    """The derivative of a state by time; its unit is that of the state per second."""
    exponents, factor = base_exponents(variable.unit)
    for unit in (f"{variable.unit}/s", f"{variable.unit}2", "1/s"):
        try:
            wanted = {**exponents, "s": exponents.get("s", 0) - 1}
            if base_exponents(unit) == ({k: v for k, v in wanted.items() if v}, factor):
                return Variable(unit, f"Derivative of: {variable.text}", nominal=variable.nominal)
        except ValueError:
            continue
    raise ValueError(f"no unit for the derivative of {variable.text}, {variable.unit}")


# The C text


def definitions(model: Model) -> list[str]:
    """Numbers and tables of the states, and the parameters that must be off."""
    found = exchange(model)
    rows = states(model)
    names = [n for n, causality, _ in model.rows if causality == "parameter"]
    still = [] if found is None else forbidden(model, found)
    first = len(model.rows) - len(names)
    return [
        f"#define SAMPLED {int(found is None)}",
        f"#define MODEL_STEP {real_text(model.step_size)}",
        f"#define N_STATES {len(rows)}",
        f"#define N_INDICATORS {indicators(model)}",
        f"#define N_STILL {len(still)}",
        f"static const double model_nominals[] = {{{', '.join(real_text(v.nominal) for _, v in rows) or '0'}}};",
        f"static const int model_still[] = {{{', '.join(str(first + names.index(n)) for n, _ in still) or '0'}}};",
        f"static const double model_still_at[] = {{{', '.join(real_text(v) for _, v in still) or '0'}}};",
    ]


def forbidden(model: Model, found: Exchange) -> list[tuple[str, float]]:
    """Parameters that must have their off value: of effects that remember, and of those with events."""
    composed = model.parts[0].composed
    keys = [e.key for e in composed.effects if e.memory] + [
        n for n in found.smooth if n in composed.parameters
    ]
    return [(key, composed.parameters[key].start if key not in found.smooth else 0.0) for key in keys]


def lines(model: Model) -> list[str]:
    """Equations with derivatives, and the functions that `c/exchange.h` calls."""
    found = exchange(model)
    if found is None:
        return []
    part = model.parts[0]
    own = f"M->{c_name(part.name)}"
    step = "step_without_event" if indicators(model) else "step"
    moving = {"coefficients": CO_SIMULATION["coefficients"], "output": CO_SIMULATION["output"]}
    moving[step] = MOVING if step == "step" else (*MOVING, REAL)
    program = program_of(part.composed, f"rate_{part.program.prefix}", moving, with_rates=True)
    fields = [f"{own}.x.{c_name(n)}" for n in found.states]
    out = [f"to[{k}] = {field};" for k, field in enumerate(fields)]
    back = [f"{field} = from[{k}];" for k, field in enumerate(fields)]
    return [
        '#include "rates.h"',
        "",
        program.text(),
        *function("model_get_states", "const Model *M, double to[]", [*out, "(void)M;", "(void)to;"]),
        *function("model_set_states", "Model *M, const double from[]", [*back, "(void)M;", "(void)from;"]),
        *rates(model, program, found, own, step),
        *(events(model, own) if indicators(model) else []),
    ]


def entries_of(model: Model) -> dict[str, int]:
    """Place of each input of a block among those of its model."""
    return {w.target[1]: k for k, w in enumerate(model.wires)}


def copied(part: Part, program: Program, layout: str, place: str, made: str = "{}") -> str:
    """Initial values of a struct from one of the same fields, each number `made` into what this text says."""
    lists = buffers(part.composed)
    places = [(n, f"{place}.{c_name(n)}") for n in program.layouts[layout].names]
    return ", ".join(at if n in lists and layout == "Memory" else made.format(at) for n, at in places) or "0"


def events(model: Model, own: str) -> list[str]:
    """What tells that an event has come, and what follows it."""
    part = model.parts[0]
    program = program_of(part.composed, f"event_{part.program.prefix}", EVENTS)
    entries = entries_of(model)
    kinds = {name: struct.c for name, struct in program.layouts.items()}
    inputs = ", ".join(f"inputs[{entries[n]}]" for n in part.composed.inputs) or "0"
    given = [
        f"const {kinds['Parameters']} p = {{{copied(part, program, 'Parameters', f'{own}.p')}}};",
        f"const {kinds['Memory']} m = {{{copied(part, program, 'Memory', f'{own}.m')}}};",
        f"const {kinds['Input']} u = {{{inputs}}};",
        f"{kinds['State']} x = {{{copied(part, program, 'State', f'{own}.x')}}};",
        f"{kinds['Coefficients']} c;",
        *(f"(void){name};" for name in ("p", "m", "u", "x", "c", "inputs", "py_fault")),
        program.call("coefficients", "c", "&p", "0.0"),
    ]
    known = ("&x", "&u", "&m", "&p", "&c")
    kind = program.entries["indicators"].result.c
    told = [
        *given,
        f"{kind} left;",
        program.call("indicators", "left", *known, "motion"),
        *(f"indicators[{k}] = left.e{k};" for k in range(indicators(model))),
    ]
    after = [
        *given,
        "if (!first) {",
        f"    {program.call('after_event', 'x', *known, '*motion')}",
        "}",
        program.call("motion_from", "*motion", *known),
        *(f"{own}.x.{c_name(n)} = x.{c_name(n)};" for n in program.layouts["State"].names),
    ]
    head = "const Model *M, const double inputs[], double motion, double indicators[], int *py_fault"
    return [
        program.text(),
        *function("model_indicators", head, told),
        *function(
            "model_event", "Model *M, const double inputs[], double *motion, int first, int *py_fault", after
        ),
    ]


def rates(model: Model, program: Program, found: Exchange, own: str, step: str) -> list[str]:
    """Derivatives of the states, and outputs, at the present states and inputs; and of both in a direction of these."""
    part = model.parts[0]
    kinds = {name: struct.c for name, struct in program.layouts.items()}

    def lifted(layout: str, place: str) -> str:
        return copied(part, program, layout, place, "pc_real({})")

    entries = entries_of(model)
    values = (
        ", ".join(
            f"pc_make(inputs[{entries[n]}], 0.0, seeds[{entries[n]}], 0.0)" for n in part.composed.inputs
        )
        or "0"
    )
    state = [
        f"x.{c_name(n)} = pc_make({own}.x.{c_name(n)}, 0.0, seeds[{len(entries) + k}], 0.0);"
        for k, n in enumerate(found.states)
    ]
    outputs = [f"outputs[{k}] = y.{c_name(n)}.value;" for k, n in enumerate(part.composed.outputs)]
    ends = [f"rates[{k}] = x1.{c_name(n)}.rate;" for k, n in enumerate(found.states)]
    slopes = [f"slopes[{k}] = y.{c_name(n)}.seed;" for k, n in enumerate(part.composed.outputs)]
    slopes += [f"slopes[{len(slopes) + k}] = x1.{c_name(n)}.both;" for k, n in enumerate(found.states)]
    assert not [b for b in buffers(part.composed).values() if b.resource]
    given = ["&x", "&u", "&m", "&p", "&c"] + (["pc_real(motion)"] if step != "step" else [])
    body = [
        f"const {kinds['Parameters']} p = {{{lifted('Parameters', f'{own}.p')}}};",
        f"const {kinds['Input']} u = {{{values}}};",
        f"const {kinds['Memory']} m = {{{lifted('Memory', f'{own}.m')}}};",
        f"{kinds['State']} x = {{{lifted('State', f'{own}.x')}}}, x1;",
        f"{kinds['Coefficients']} c;",
        f"{kinds['Output']} y;",
        *(f"(void){name};" for name in ("m", "p", "u", "rates", "inputs", "seeds", "motion", "py_fault")),
        program.call("coefficients", "c", "&p", "pc_real(0.0)"),
        program.call(step, "x1", *given),
        "x = x1; /* what it keeps of the input is that of now */",
        *state,
        program.call("output", "y", "&x", "&u", "&m", "&p"),
        *outputs,
        program.call("coefficients", "c", "&p", "pc_make(0.0, 1.0, 0.0, 0.0)"),
        program.call(step, "x1", *given),
        *ends,
        *slopes,
        "(void)c;",
        "(void)x1;",
    ]
    head = (
        "const Model *M, const double inputs[], double motion, const double seeds[], double outputs[], double rates[], "
        "double slopes[], int *py_fault"
    )
    return function("model_rates", head, body)


# The description


def extended(root: etree._Element, model: Model, content: bytes) -> etree._Element:
    """Add model exchange, states and derivatives to a description, whose GUID follows again from all of it."""
    rows = states(model)
    slave = root.find("CoSimulation")
    flags = {f: slave.get(f) for f in ("canNotUseMemoryManagementFunctions", "canGetAndSetFMUstate",
                                       "canSerializeFMUstate", "needsExecutionTool")}  # fmt: skip
    sources = E.SourceFiles(*(E.File(name=f.get("name")) for f in slave.findall("SourceFiles/File")))
    slave.addprevious(
        E.ModelExchange(
            sources,
            modelIdentifier=model.name,
            completedIntegratorStepNotNeeded="true",
            providesDirectionalDerivative="false" if exchange(model) is None else "true",
            **flags,
        )
    )
    known = [v for _, _, v in model.rows]
    every = [*known, *(v for _, v in rows), *(derivative_of(v) for _, v in rows)]
    root.replace(root.find("UnitDefinitions"), unit_definitions(every))
    variables, structure = root.find("ModelVariables"), root.find("ModelStructure")
    first, n = len(known), len(rows)
    for k, (name, variable) in enumerate(rows):
        variables.append(local(name, first + k, variable))
    for k, (name, variable) in enumerate(rows):
        node = local(f"der({name})", first + n + k, derivative_of(variable))
        node[0].set("derivative", str(first + k + 1))
        variables.append(node)
    depend(structure, model, {name: k for k, (name, _, _) in enumerate(model.rows, 1)})
    if indicators(model):
        root.set("numberOfEventIndicators", str(indicators(model)))
    root.set("guid", "")
    digest = hashlib.sha256(etree.tostring(root) + content).hexdigest()
    root.set("guid", f"{{{uuid.UUID(digest[:32])}}}")
    return root


def depend(structure: etree._Element, model: Model, index: dict[str, int]) -> None:
    """Add to ModelStructure the states that outputs depend on, and states and derivatives with what these depend on.

    Args:
        structure: of the model as a slave.
        model: it has one part.
        index: of each variable but states and derivatives, which follow.
    """
    part, found = model.parts[0], exchange(model)
    if found is None:
        return
    places = {f"x.{name}": len(index) + k for k, name in enumerate(found.states, 1)}
    shown, start, stepped = (f(part.composed) for f in (of_states, at_start, after_step))
    outputs, unknowns = structure.find("Outputs"), structure.find("InitialUnknowns")
    for node, (name, _) in zip(outputs, model.of("output"), strict=True):
        own = [int(i) for i in node.get("dependencies", "").split()]
        node.set(
            "dependencies",
            unknown(0, [*own, *(places[n] for n in shown[name] if n in places)]).get("dependencies"),
        )
    if not places:
        return
    derivatives = E.Derivatives()
    for name, place in places.items():
        unknowns.append(unknown(place, [index[n] for n in start[name]]))
    for (name, place), knowns in zip(places.items(), found.states.values(), strict=True):
        known = [index[n] if n in part.composed.inputs else places[f"x.{n}"] for n in knowns]
        derivatives.append(unknown(place + len(places), known))
        first = {n for n in knowns if n in part.composed.inputs} | {
            n for n in stepped[name.removeprefix("x.")] if n in part.composed.parameters
        }
        first |= {n for state in knowns for n in start.get(f"x.{state}", ())}
        unknowns.append(unknown(place + len(places), [index[n] for n in first]))
    outputs.addnext(derivatives)


def local(name: str, reference: int, variable: Variable) -> etree._Element:
    """A calculated variable that is neither input nor output."""
    node = scalar_variable(name, reference, "output", variable, 0.0)
    node.set("causality", "local")
    return node
