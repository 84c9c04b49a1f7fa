"""The flattened step gives, bit for bit, what the composed equations give."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from fmu_bench import bare, run, with_fill
from hypothesis import given, settings
from hypothesis import strategies as st

from fmus import registry
from fmus.build import composed_block
from fmus.compose import Composed
from fmus.contract import Buffer, Variable, equation
from fmus.specialise import flat_text

TABLE = [[0.0, 0.1, 0.3], [0.2, -0.7, 1.0]]  # what the stimulus plays
STEPPERS: dict[str, Callable[..., Any]] = {}


def stepper(composed: Composed) -> Callable[..., Any]:
    """The function that a flattened text defines, made once for each text."""
    if composed.source not in STEPPERS:
        scope: dict[str, Any] = {}
        exec(flat_text(composed), scope)
        STEPPERS[composed.source] = scope["stepper"]
    return STEPPERS[composed.source]


def buffers(composed: Composed) -> list[list[float]]:
    arrays = [b for b in composed.memory.values() if isinstance(b, Buffer)]
    return [list(TABLE[i]) if b.resource else [0.0] * b.length for i, b in enumerate(arrays)]


def compare(
    composed: Composed, flat: Composed, rows: np.ndarray, steps: np.ndarray, parameters: dict[str, float]
) -> int:
    """Step both forms side by side through changing step sizes; how many steps both made before both failed alike."""
    rows, steps = rows.tolist(), steps.tolist()  # Python's floats, as an FMU gets them
    r = run(composed, steps[0], [*rows[0]], parameters, buffers(composed))
    n, n_out = len(composed.inputs), len(composed.outputs)
    values = [0.0] * (n + n_out)
    h, now = steps[0], 0.0
    again = composed.module.begin(r.x, composed.module.Input(*rows[0]), r.p, buffers(composed))

    def resized(time: float, step: float) -> bool:
        r.c = composed.module.coefficients(r.p, step)
        renew(r.c, step)
        return True

    def failed(time: float, error: Exception | None) -> bool:
        failures.append(error)
        return False

    failures: list[Exception | None] = []
    do_step, renew, running = stepper(flat)(values, r.p, r.c, r.x, again, h, resized, failed)
    for k, (row, step) in enumerate(zip(rows, steps, strict=True)):
        time, now = now, now + step
        if step != h:
            h, r.c = step, composed.module.coefficients(r.p, step)
        inputs = [*row[:n], now] if composed.takes_time else [*row]
        values[:n] = inputs[:n]
        sound = do_step(time, step)
        if failures and failures[0] is not None:
            with pytest.raises(type(failures[0])):
                r.step(*inputs)
            return k
        expected = r.step(*inputs)
        assert sound == (-1e300 < values[n] < 1e300)
        assert failures == ([] if sound else [None])
        failures.clear()
        assert [x.hex() for x in map(float, values[n:])] == [x.hex() for x in map(float, expected)]
        x, m = running()
        for found, known in ((x, tuple(r.x)), (m, tuple(r.m))):
            assert found == known or repr(found) == repr(known)  # NaN equals nothing, but its text
    return len(rows)


def lively(composed: Composed, seed: int, count: int = 120) -> tuple[np.ndarray, np.ndarray]:
    """Inputs of typical size with rests and reversals, and step sizes that change now and then."""
    rng = np.random.default_rng(seed)
    size = np.array([0.0 if v.kind == "time" else 2.0 * v.nominal for v in composed.block.inputs.values()])
    rows = np.repeat(rng.normal(0.0, 1.0, (count // 4, len(size))), 4, axis=0)[:count] * size
    rows[rng.random(len(rows)) < 0.1] = 0.0
    return rows, np.repeat(rng.choice([1e-3, 1e-3, 2.5e-3, 0.02], len(rows) // 20 + 1), 20)[: len(rows)]


@pytest.mark.parametrize("name", registry.BLOCKS)
def test_without_effects(name) -> None:
    """The nominal FMU: the block's own equations in place of those with all effects, which are off."""
    full, plain = composed_block(name), bare(name)
    for seed in range(5):
        assert compare(full, plain, *lively(full, seed), {}) == 120


@pytest.mark.parametrize("name", registry.BLOCKS)
def test_with_effects_off_in_the_full_text(name) -> None:
    full = composed_block(name)
    assert compare(full, full, *lively(full, 7), {}) == 120


@pytest.mark.parametrize("name", [n for n, e in registry.effects().items() if e.component in registry.BLOCKS])
def test_each_effect_on(name) -> None:
    effect = registry.effects()[name]
    full = composed_block(effect.component)
    on = {n: f.starts[0] for n, f in effect.free.items() if n in full.parameters}
    for seed in range(3):
        assert compare(full, full, *lively(full, seed), on) == 120


@st.composite
def cases(draw: Callable[..., Any]) -> tuple[str, dict[str, float], int]:
    """A block, values of any of its parameters anywhere within their bounds or near their start, and a seed of inputs."""
    name = draw(st.sampled_from(registry.BLOCKS))
    parameters = composed_block(name).parameters
    chosen = draw(st.lists(st.sampled_from(sorted(parameters)), unique=True, max_size=6))
    values = {}
    for key in chosen:
        v = parameters[key]
        near = st.floats(-2.0, 2.0).map(
            lambda a, v=v: min(v.high, max(v.low, v.start + a * (v.start or v.nominal)))
        )
        value = draw(st.one_of(near, st.floats(v.low, v.high)))
        values[key] = float(round(value)) if v.kind == "integer" else value
    return name, values, draw(st.integers(0, 1000))


@settings(max_examples=150, deadline=None)
@given(cases())
def test_any_parameters(case) -> None:
    """Both forms agree or both fail, whatever the parameters."""
    name, values, seed = case
    full = composed_block(name)
    try:
        run(full, 1e-3, [v.start for v in full.block.inputs.values()], values, buffers(full))
    except (ArithmeticError, ValueError):
        return  # refused at initialisation, before any step
    rows, steps = lively(full, seed, 40)
    compare(full, full, rows, steps, values)
    keys = {e.key: full.parameters[e.key].start for e in full.effects}
    if all(values.get(key, off) == off for key, off in keys.items()):
        compare(full, bare(name), rows, steps, values)


def test_what_cannot_be_flattened_is_refused() -> None:
    @equation
    def whole_tuple(theta, m, p):
        return theta * (p,)[0].trial

    with pytest.raises(ValueError, match=r"whole_tuple: .* cannot be flattened"):
        flat_text(
            with_fill("sensor", "sensed_angle", whole_tuple, trial=Variable("1", "size", source="test"))
        )


def test_names_that_are_taken_are_refused() -> None:
    @equation
    def takes_now(theta, m, p):
        now = theta * p.trial
        return now + theta

    with pytest.raises(ValueError, match="'now'"):
        flat_text(with_fill("sensor", "sensed_angle", takes_now, trial=Variable("1", "size", source="test")))
