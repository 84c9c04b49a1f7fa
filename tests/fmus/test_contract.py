"""One suite over every block and every effect: declarations, composed text, neutrality of effects that are off."""

import ast
import inspect
import math
import subprocess
import sys

import numpy as np
import pytest
from fmu_bench import run

from cosim.units import factor, parse_unit
from fmus import registry
from fmus.build import composed_block
from fmus.compose import Composed, compose
from fmus.contract import Block, Buffer, Effect, Variable, equation

BLOCKS = registry.BLOCKS
EFFECTS = registry.effects()
# what an effect changes where nominally there is none of it: friction without a level has no sides that differ
ACTS_ON = {"mechanical.coulomb_asymmetry": {"tau_c": 60.0}}
TABLES = {"stimulus": [[0.0, 0.1, 0.3], [0.2, -0.7, 1.0]]}  # what a block plays from a file


def declared(block: Block) -> dict[str, Variable]:
    """Every variable of a block with the effects that act on it."""
    composed = composed_block(block.name)
    memory = {n: v for n, v in composed.memory.items() if isinstance(v, Variable)}
    return block.inputs | block.outputs | block.states | composed.parameters | memory


@pytest.fixture(params=BLOCKS)
def block(request: pytest.FixtureRequest) -> Block:
    return registry.block(request.param)


def test_every_unit_can_be_read_and_shown(block: Block) -> None:
    for name, v in declared(block).items():
        parse_unit(v.unit)
        if v.display is not None:
            assert factor(v.unit, v.display) > 0, name


def test_every_variable_says_what_it_is_within_its_bounds(block: Block) -> None:
    for name, v in declared(block).items():
        assert v.text, name
        assert v.low <= v.start <= v.high, name
        assert v.low < v.high, name
        assert all(map(math.isfinite, (v.low, v.start, v.high))), name
        assert v.nominal > 0, name


def test_every_parameter_has_a_source(block: Block) -> None:
    for name, v in composed_block(block.name).parameters.items():
        assert v.source, f"{name} has no source"


def test_integers_are_whole(block: Block) -> None:
    for name, v in declared(block).items():
        if v.kind == "integer":
            assert {v.low, v.start, v.high} <= {int(v.low), int(v.start), int(v.high)}, name


def test_names_serve_every_client(block: Block) -> None:
    """Identifiers of at most 55 characters (Simulink), and no two FMI variables of one name."""
    composed = composed_block(block.name)
    names = [*composed.inputs, *composed.outputs, *composed.parameters]
    assert len(set(names)) == len(names)
    assert len({n.lower() for n in names}) == len(names), "case alone separates two names"
    for name in names:
        assert name.isidentifier(), name
        assert name.isascii(), name
        assert len(name) <= 55, name


def test_block_is_registered_under_its_own_name(block: Block) -> None:
    assert block.module.__name__ == f"fmus.{block.name}"
    assert set(block.feedthrough) <= set(block.outputs)
    assert {i for inputs in block.feedthrough.values() for i in inputs} <= set(block.inputs)


def global_names(source: str) -> set[str]:
    """Names that the functions of a text read from outside themselves."""
    found: set[str] = set()

    def walk(code: object) -> None:
        for instruction in code.co_consts:  # type: ignore[attr-defined]
            if inspect.iscode(instruction):
                walk(instruction)
        found.update(n for n in code.co_names)  # type: ignore[attr-defined]

    walk(compile(source, "text", "exec"))
    return found


def attributes(source: str) -> set[str]:
    return {n.attr for n in ast.walk(ast.parse(source)) if isinstance(n, ast.Attribute)}


def test_equations_use_math_and_their_own_names_only(block: Block) -> None:
    composed = composed_block(block.name)
    known = (
        set(vars(composed.module)) | {"abs", "min", "max", "int", "float", "range", "len"} | {"collections"}
    )
    assert global_names(composed.source) - attributes(composed.source) <= known
    imports = [n for n in ast.walk(ast.parse(composed.source)) if isinstance(n, ast.Import | ast.ImportFrom)]
    assert {ast.unparse(i) for i in imports} == {"import math", "from collections import namedtuple"}


def test_feedthrough_is_what_is_declared(block: Block) -> None:
    """An output reacts to an input without a step exactly where the model description says so."""
    composed = compose(block)
    base = [0.3 * v.nominal for v in block.inputs.values()]
    r = run(composed, 1e-3, base, buffers=TABLES.get(block.name))
    for i, name in enumerate(composed.inputs):
        moved = list(base)
        moved[i] += 0.2 * block.inputs[name].nominal
        after = []
        for inputs in (base, moved):
            # feedthrough of these blocks acts at communication points: same state before, one vanishing step
            again = run(composed, 1e-7, base, buffers=TABLES.get(block.name))
            again.x = r.x
            after.append(again.step(*inputs))
        for output, one, other in zip(block.outputs, *after, strict=True):
            jumps = abs(one - other) > 1e-3 * block.outputs[output].nominal
            assert jumps == (name in block.feedthrough.get(output, ())), (name, output)


# in manual; without the corrections, which are made once a step
SETTINGS = {
    "reference": {"t_switch": 1.0},
    "observer_extended": {"l_theta": 0.0, "l_omega": 0.0, "l_tau": 0.0},
}
# a switch from manual to automatic starts a transition of so many steps; the reference goes to its target in whole steps
DIGITAL = {("controller", "automatic"), ("reference", "command")}


def test_what_an_input_stands_for_over_a_step_is_what_is_declared(block: Block) -> None:
    """One long step is 64 short ones in which the input stands still, goes on a straight line, or either."""
    composed = compose(block)
    assert set(block.reads) == set(composed.inputs)
    parameters = SETTINGS.get(block.name, {})
    base = [0.0 if v.kind == "time" else 0.3 * v.nominal for v in block.inputs.values()]
    for i, name in enumerate(composed.inputs):
        if (block.name, name) in DIGITAL or block.reads[
            name
        ] == "start":  # tests/fmus/test_continuity_physical.py
            continue
        moved = list(base)
        moved[i] += 0.2 * block.inputs[name].nominal

        def over(parts: int, line: bool, moved: list[float] = moved) -> np.ndarray:
            h = 0.02 / parts
            r = run(composed, h, base, parameters, TABLES.get(block.name))
            for k in range(parts):
                share = (k + 1) / parts if line else 1.0
                inputs = [b + share * (m - b) for b, m in zip(base, moved, strict=True)]
                if "time" in block.inputs:
                    inputs[list(block.inputs).index("time")] = (k + 1) * h
                last = r.step(*inputs)
            return np.array(last)

        sizes = np.array([v.nominal for v in block.outputs.values()])
        whole, held, line = (over(*way) / sizes for way in ((1, False), (64, False), (64, True)))
        from_held, from_line = np.abs(whole - held).max(), np.abs(whole - line).max()
        if max(from_held, from_line) < 1e-12:
            assert block.reads[name] in ("instant", "line"), name  # a filter that is off by default
        else:
            assert block.reads[name] == ("held" if from_held < 0.02 * from_line else "line"), name
            assert min(from_held, from_line) < 0.02 * max(from_held, from_line), name


def trajectory(composed: Composed, seed: int = 0, h: float = 1e-2, **parameters: float) -> np.ndarray:
    """Outputs over 200 steps under inputs of typical size."""
    rng = np.random.default_rng(seed)
    block = composed.block
    size = np.array([0.0 if v.kind == "time" else 2.0 * v.nominal for v in block.inputs.values()])
    rows = rng.normal(0.0, 1.0, (200, len(size))) * size
    if composed.takes_time:
        rows[:, -1] = h * np.arange(200)
    arrays = [b for b in composed.memory.values() if isinstance(b, Buffer)]
    buffers = [*TABLES.get(block.name, []), *([0.0] * b.length for b in arrays if b.length)]
    return run(composed, h, rows[0], parameters, buffers).play(rows)


def test_effects_that_are_off_change_no_bit(block: Block) -> None:
    assert np.array_equal(trajectory(compose(block)), trajectory(composed_block(block.name)))


@pytest.mark.parametrize("name", [n for n, e in EFFECTS.items() if e.component in BLOCKS])
def test_each_effect_alone_is_neutral_when_off_and_acts_when_on(name: str) -> None:
    effect = EFFECTS[name]
    block = registry.block(effect.only or effect.component)
    composed = compose(block, [effect])
    given = ACTS_ON.get(name, {})
    bare_one = trajectory(compose(block), **given)
    assert np.array_equal(bare_one, trajectory(composed, **given))
    v = composed.parameters[effect.key]
    free = effect.free[effect.key]
    on = {n: f.starts[-1] for n, f in effect.free.items() if n in composed.parameters} | {
        effect.key: free.starts[-1]
    }
    assert v.low <= on[effect.key] <= v.high
    if effect.fills or effect.memory:
        assert not np.array_equal(bare_one, trajectory(composed, **given, **on))


def test_every_slot_is_reached(block: Block, monkeypatch: pytest.MonkeyPatch) -> None:
    """A fill that doubles or adds shows in the outputs of the block: no slot is declared and never called."""
    for slot, rule in block.slots.items():
        function = getattr(block.module, slot)
        arguments = list(inspect.signature(function).parameters)
        body = "p.trial" if rule == "sum" else f"{arguments[0]} * (1.0 + p.trial)"
        text = f"def trial_fill({', '.join(arguments)}):\n    return {body}\n"
        scope: dict[str, object] = {}
        exec(text, scope)
        fill = equation(scope["trial_fill"])  # type: ignore[type-var]
        real = inspect.getsource
        monkeypatch.setattr(
            inspect, "getsource", lambda f, fill=fill, text=text, real=real: text if f is fill else real(f)
        )
        effect = Effect(
            name=f"{block.name}.trial", text="trial", residual="none", source="test", key="trial",
            parameters={"trial": Variable("1", "size", 0.0, source="test")}, fills={slot: fill},
        )  # fmt: skip
        composed = compose(block, [effect])
        assert np.array_equal(trajectory(compose(block)), trajectory(composed)), slot
        assert not np.array_equal(trajectory(composed), trajectory(composed, trial=0.5)), slot


def test_composed_text_runs_with_the_standard_library_alone(block: Block) -> None:
    """In an isolated interpreter without site packages."""
    done = subprocess.run(
        [sys.executable, "-I", "-S", "-c", "import sys; exec(sys.stdin.read()); print(sorted(sys.modules))"],
        input=composed_block(block.name).source, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert "numpy" not in done.stdout


def test_composing_twice_gives_one_text(block: Block) -> None:
    assert composed_block(block.name).source == composed_block(block.name).source
    assert len(composed_block(block.name).digest) == 12


def test_unknown_names_answer_with_the_closest() -> None:
    with pytest.raises(KeyError, match="did you mean mechanical"):
        registry.block("mechanicl")


def test_an_effect_that_does_not_fit_is_refused() -> None:
    friction = EFFECTS["mechanical.gravity_load"]
    with pytest.raises(ValueError, match="load_torque"):
        compose(registry.block("sensor"), [friction])


def test_effects_are_named_after_a_component_and_a_parameter_they_change() -> None:
    for name, effect in EFFECTS.items():
        assert effect.name == name
        assert effect.text, name
        assert effect.residual, name
        assert effect.source, name
        if effect.component in BLOCKS:
            parameters = composed_block(effect.only or effect.component).parameters
            assert effect.key in parameters, name
            assert set(effect.free) <= set(parameters), name
            for parameter, free in effect.free.items():
                v = parameters[parameter]
                assert all(v.low <= s <= v.high for s in free.starts), (name, parameter)
