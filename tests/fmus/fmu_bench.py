"""Drives composed blocks from Python, and exact references that do not use the blocks' own formulas."""

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.linalg import expm

from fmus import registry
from fmus.compose import Composed, compose
from fmus.contract import Buffer, Effect


def bare(name: str) -> Composed:
    """Block `name` without effects."""
    return compose(registry.block(name))


@dataclass
class Run:
    """A block between two steps, so that a test can look at it and go on."""

    composed: Composed
    h: float
    x: Any
    m: Any
    p: Any
    c: Any

    def step(self, *inputs: float) -> tuple[float, ...]:
        """One step of length h with these inputs; the outputs at its end."""
        module = self.composed.module
        u = module.Input(*inputs)
        self.x, self.m = module.advance(self.x, self.m, u, self.p, self.c)
        return tuple(module.output(self.x, u, self.m, self.p))

    def play(self, rows: Sequence[Sequence[float]] | np.ndarray) -> np.ndarray:
        """Outputs after each row of inputs, one step a row."""
        return np.array([self.step(*row) for row in rows])


def run(
    composed: Composed,
    h: float,
    first: Sequence[float],
    parameters: Mapping[str, float] | None = None,
    buffers: Sequence[list[float]] | None = None,
    **states: float,
) -> Run:
    """A block at its start: inputs `first`, start values but for `parameters`, states overridden by `states`."""
    module = composed.module
    values = {name: v.start for name, v in composed.parameters.items()}
    assert not set(parameters or {}) - set(values)
    p = module.Parameters(**values | dict(parameters or {}))
    u = module.Input(*first)
    x = module.start(u, p)._replace(**states)
    arrays = [b for b in composed.memory.values() if isinstance(b, Buffer)]
    m = module.begin(x, u, p, buffers or [[0.0] * b.length for b in arrays])
    return Run(composed, h, x, m, p, module.coefficients(p, h))


def ramp_response(
    A: np.ndarray, B: np.ndarray, x0: Sequence[float], inputs: np.ndarray, h: float, held: Sequence[bool]
) -> np.ndarray:
    """States of x' = A x + B u after each row of `inputs` but the first, by scipy's matrix exponential.

    A `held` input keeps the value of its new row over the step, the others move on a straight line to it.
    """
    n, k = B.shape
    block = np.zeros((n + 2 * k, n + 2 * k))
    block[:n, :n], block[:n, n : n + k] = A, B
    block[n : n + k, n + k :] = np.eye(k) / h
    over = expm(block * h)[:n]
    x, rows = np.asarray(x0, float), []
    hold = np.asarray(held)
    for old, new in itertools.pairwise(inputs):
        begin = np.where(hold, new, old)
        x = over @ np.concatenate([x, begin, new - begin])
        rows.append(x)
    return np.array(rows)


def orders(errors: Sequence[float]) -> np.ndarray:
    """Observed orders of convergence of errors at successively halved steps."""
    e = np.asarray(errors, float)
    return np.log2(e[:-1] / e[1:])


def with_fill(block: str, slot: str, fill: Any, **parameters: Any) -> Composed:
    """Block `block` with one effect made for a test, acting in `slot`; on where its first parameter is not 0."""
    effect = Effect(
        name=f"{block}.trial",
        text="made for a test",
        residual="none",
        source="test",
        key=next(iter(parameters)),
        parameters=parameters,
        fills={slot: fill},
    )
    return compose(registry.block(block), [effect])
