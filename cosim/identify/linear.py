"""Exact responses of linear systems to sampled inputs, for fits that try many of them.

With ``D(s) z = u`` and D monic of order n, the outputs of all transfer functions ``B(s)/D(s)`` are sums of z and its
derivatives, so a fit needs them once for each D: `responses`. What is left of the past is a sum of `free_responses`.
"""

from collections.abc import Sequence

import numba
import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@numba.njit(cache=True)  # type: ignore[untyped-decorator,unused-ignore]
def _product(a: Array, b: Array) -> Array:
    n = a.shape[0]
    out = np.zeros((n, n))
    for i in range(n):
        for k in range(n):
            if a[i, k] != 0.0:
                for j in range(n):
                    out[i, j] += a[i, k] * b[k, j]
    return out


@numba.njit(cache=True)  # type: ignore[untyped-decorator,unused-ignore]
def _exponential(a: Array) -> Array:
    """Matrix exponential of a small matrix, by its series after halving; scipy's takes ten times as long at this size."""
    n = a.shape[0]
    norm = 0.0
    for i in range(n):
        norm = max(norm, np.sum(np.abs(a[i])))
    halvings = 0
    while norm > 0.25:
        norm *= 0.5
        halvings += 1
    small = a / 2.0**halvings
    out, term = np.eye(n), np.eye(n)
    for k in range(1, 13):  # 0.25^13 / 13! is far below rounding
        term = _product(term, small) / k
        out = out + term
    for _ in range(halvings):
        out = _product(out, out)
    return out


def discretised(denominator: Array, h: float, held: bool) -> tuple[Array, Array, Array]:
    """Transition over a step of the companion form of a monic denominator.

    Args:
        denominator: coefficients (n + 1,) of falling powers, the first 1.
        h: step, in the denominator's unit of time.
        held: the input keeps its value over a step; else it goes on a straight line.

    Returns:
        ``F`` (n, n), ``g0`` and ``g1`` (n,): ``x[k+1] = F x[k] + g0 u[k] + g1 u[k+1]``; x is z and its derivatives.
    """
    n = denominator.size - 1
    system = np.zeros((n + 2, n + 2))
    system[: n - 1, 1:n] = np.eye(n - 1)
    system[n - 1, :n] = -denominator[:0:-1]
    system[n - 1, n] = 1.0  # the input
    system[n, n + 1] = 1.0  # its slope
    over = _exponential(system * h)
    whole, ramp = over[:n, n], over[:n, n + 1] / h
    g0, g1 = (whole, np.zeros(n)) if held else (whole - ramp, ramp)
    # in pieces of memory of their own: what marches over a log is compiled for one kind of array
    return np.ascontiguousarray(over[:n, :n]), np.ascontiguousarray(g0), g1


@numba.njit(cache=True)  # type: ignore[untyped-decorator,unused-ignore]
def _march(f: Array, g0: Array, g1: Array, u: Array, out: Array) -> None:
    """Fill `out` (n, N) with the states from rest."""
    n = f.shape[0]
    x, new = np.zeros(n), np.zeros(n)
    for k in range(u.size):
        out[:, k] = x
        if k + 1 < u.size:
            for i in range(n):
                total = g0[i] * u[k] + g1[i] * u[k + 1]
                for j in range(n):
                    total += f[i, j] * x[j]
                new[i] = total
            x[:] = new


@numba.njit(cache=True)  # type: ignore[untyped-decorator,unused-ignore]
def _decay(f: Array, out: Array) -> None:
    """Fill `out` (n, N) with z after a unit start of each state in turn: the first row of the powers of f."""
    n = f.shape[0]
    row, new = np.zeros(n), np.zeros(n)
    row[0] = 1.0
    for k in range(out.shape[1]):
        out[:, k] = row
        for j in range(n):
            total = 0.0
            for i in range(n):
                total += row[i] * f[i, j]
            new[j] = total
        row[:] = new


def time_scale(denominator: Array) -> float:
    """A typical rate of the poles [1/s], by which time is scaled: powers of raw rates would swamp each other."""
    size = np.abs(np.roots(denominator))
    size = size[size > 0.0]
    return float(np.exp(np.mean(np.log(size)))) if size.size else 1.0


def responses(denominator: Array, u: Array, h: float, held: bool) -> Array:
    """``s^j / D(s)`` for j = 0 .. n - 1 applied to a sampled input, from rest.

    Args:
        denominator: monic, (n + 1,), falling powers of s.
        u: input (N,) every `h` seconds.
        h: [s].
        held: see `discretised`.

    Returns:
        (n, N); row j is the response of ``s^j / D(s)``.
    """
    n, w = denominator.size - 1, time_scale(denominator)
    f, g0, g1 = discretised(denominator * w ** -np.arange(n + 1.0), h * w, held)
    out = np.empty((n, u.size))
    _march(f, g0, g1, np.ascontiguousarray(u), out)
    return out * w ** (np.arange(n)[:, None] - float(n))


def free_responses(denominator: Array, count: int, h: float) -> Array:
    """The n motions (n, count) that a system with this denominator (n + 1,) makes by itself, sampled every `h` seconds."""
    n, w = denominator.size - 1, time_scale(denominator)
    f, _, _ = discretised(denominator * w ** -np.arange(n + 1.0), h * w, True)
    out = np.empty((n, count))
    _decay(f, out)
    return out


def simulate(
    numerator: Sequence[float] | Array, denominator: Sequence[float] | Array, u: Array, h: float, held: bool
) -> Array:
    """Response (N,) of ``B(s)/A(s)``, coefficients of falling powers, B of lower order, to an input (N,), from rest."""
    a = np.asarray(denominator, dtype=np.float64)
    b = np.asarray(numerator, dtype=np.float64) / a[0]
    rows = responses(a / a[0], u, h, held)
    return np.asarray(b[::-1] @ rows[: b.size])


def delayed(u: Array, steps: float) -> Array:
    """An input (N,) later by a number of steps: a held one's mean over each step, a straight line between samples."""
    steps = max(steps, 0.0)
    whole = int(steps)
    part = steps - whole
    padded = np.concatenate([np.full(whole + 1, u[0]), u])
    return (1.0 - part) * padded[1 : u.size + 1] + part * padded[: u.size]
