"""Directional derivatives in model exchange: those of the equations, found by differences, and none where none is listed."""

import math
import subprocess
from importlib.resources import files

import numpy as np
import pytest
from fmpy.fmi1 import FMICallException
from test_native_exchange import ACTING, RIGHT_HAND_SIDES, Exchanged, structure

from cosim.native.build import compiler
from cosim.native.exchange import EXCHANGE
from fmus import registry


def derivative(slave: Exchanged, unknowns: list[str], knowns: list[str], seed: list[float]) -> np.ndarray:
    vr = slave.vr
    found = slave.fmu.getDirectionalDerivative([vr[n] for n in unknowns], [vr[n] for n in knowns], seed)
    return np.array(found)


def extrapolated(difference, h: float):
    """A central difference of step h without its errors of second and fourth order (Richardson)."""
    one, two, four = (difference(h / k) for k in (1.0, 2.0, 4.0))
    first, second = (4.0 * two - one) / 3.0, (4.0 * four - two) / 3.0
    return (16.0 * second - first) / 15.0


@pytest.mark.parametrize("block", RIGHT_HAND_SIDES)
def test_they_are_those_of_differences_and_of_the_lists(unpacked, block) -> None:
    _, states, inputs, _ = RIGHT_HAND_SIDES[block]
    knowns = [f"x.{n}" for n in EXCHANGE[block].states] + list(registry.block(block).inputs)
    unknowns = [*registry.block(block).outputs, *(f"der(x.{n})" for n in EXCHANGE[block].states)]
    rng, slave = np.random.default_rng(6), Exchanged(unpacked[block], block, **ACTING[block])
    sizes = np.array([*states, *inputs])

    def at(numbers):
        slave.set(**dict(zip(knowns[len(states) :], numbers[len(states) :], strict=True)))
        rates = slave.rates(*numbers[: len(states)])
        return np.array([*slave.get(*registry.block(block).outputs), *rates])

    listed = structure(unpacked[block], "Outputs") | structure(unpacked[block], "Derivatives")
    for _ in range(20):
        numbers = sizes * rng.uniform(0.8, 1.2, len(sizes))
        whole = at(numbers)
        for k, name in enumerate(knowns):
            way = sizes[k] * (np.arange(len(sizes)) == k)
            expected = extrapolated(
                lambda h, x=numbers, w=way: (at(x + h * w) - at(x - h * w)) / (2.0 * h), 1e-3
            )
            expected /= sizes[k]
            at(numbers)
            found = derivative(slave, unknowns, [name], [1.0])
            # of differences: what rounding leaves of the numbers
            scale = np.abs(whole) / sizes[k] + np.abs(expected)
            assert np.all(np.abs(found - expected) <= 1e-9 * scale), (name, found, expected)
            assert all(v == 0.0 for n, v in zip(unknowns, found, strict=True) if name not in listed[n])
        seed = rng.normal(size=len(knowns)) * sizes
        along = sum(derivative(slave, unknowns, [n], [s]) for n, s in zip(knowns, seed, strict=True))
        assert derivative(slave, unknowns, knowns, list(seed)) == pytest.approx(along, rel=1e-12)
        np.testing.assert_array_equal(at(numbers), whole)  # nothing was changed


def test_a_linear_block_has_its_coefficients(unpacked) -> None:
    slave = Exchanged(unpacked["simplified"], "simplified", a=3.0, k=0.2)
    slave.rates(0.4, 0.1)
    assert list(derivative(slave, ["der(x.omega)", "der(x.theta)"], ["x.omega"], [1.0])) == [-3.0, 1.0]
    assert list(derivative(slave, ["der(x.omega)"], ["command"], [2.0])) == [0.4]
    assert list(derivative(slave, ["theta", "omega"], ["x.theta", "x.omega"], [5.0, 7.0])) == [5.0, 7.0]


def test_static_blocks_have_their_slopes(unpacked) -> None:
    zone = Exchanged(unpacked["dead_zone"], "z", m_r=1.5)
    for command, slope in ((0.6, 1.5), (0.1, 0.0), (-0.7, 1.0), (9.0, 0.0)):
        zone.set(command=command)
        assert list(derivative(zone, ["demand"], ["command"], [1.0])) == [slope]
    sensor = Exchanged(unpacked["sensor"], "s", gain=2.0)
    assert list(derivative(sensor, ["slew"], ["theta"], [3.0])) == [6.0]


@pytest.mark.parametrize(
    ("unknown", "known", "text"),
    [
        ("der(x.omega)", "J", "by inputs and states, and number 3 is neither"),
        ("p_load", "x.omega", "of outputs and derivatives, and number 0 is neither"),
        ("theta", "theta", "by inputs and states, and number 1 is neither"),
    ],
)
def test_what_has_none_is_refused(unpacked, unknown, known, text) -> None:
    slave = Exchanged(unpacked["mechanical"], "m")
    with pytest.raises(FMICallException):
        derivative(slave, [unknown], [known], [1.0])
    assert text in slave.messages[0]


ONE = {"sin": math.sin, "cos": math.cos, "tan": math.tan, "exp": math.exp, "expm1": math.expm1, "log": math.log,
       "log10": math.log10, "log2": math.log2, "log1p": math.log1p, "sqrt": math.sqrt, "sinh": math.sinh, "cosh": math.cosh,
       "asin": math.asin, "acos": math.acos, "atanh": math.atanh}  # fmt: skip
SAFE = {
    "tanh": math.tanh,
    "atan": math.atan,
    "asinh": math.asinh,
    "erf": math.erf,
    "erfc": math.erfc,
    "fabs": abs,
}
TWO = {"divide": lambda a, b: a / b, "power": lambda a, b: a**b, "times": lambda a, b: a * b,
       "atan2": math.atan2, "minus": lambda a, b: a - b, "modulo": lambda a, b: a % b}  # fmt: skip


def test_second_derivatives_of_every_function(tmp_path) -> None:
    """Along z = (x + h, y + 2 h) and seeds 3 and 1: mixed second derivatives by differences of math's own functions."""
    calls = (
        [f"pc_{n}(a, &fault)" for n in ONE]
        + [f"pc_{n}(a)" for n in SAFE]
        + ["pc_acosh(pc_plus(a, pc_real(1.0)), &fault)"]
    )
    calls += [f"pc_{n}(a, b, &fault)" if n in ("divide", "power", "modulo") else f"pc_{n}(a, b)" for n in TWO]
    lines = "\n".join(f'z = {c}; printf("%.17g %.17g %.17g\\n", z.rate, z.seed, z.both);' for c in calls)
    (tmp_path / "main.c").write_text(
        '#include <stdio.h>\n#include "semantics.h"\n#include "rates.h"\nint main(void) {\nint fault = 0;\n'
        f"py_dual z, a = pc_make(0.6, 1.0, 3.0, 0.5), b = pc_make(0.35, 2.0, 1.0, 0.25);\n{lines}\nreturn fault;\n}}\n"
    )
    folder = files("cosim.native") / "c"
    command = [*compiler(), "-std=c99", f"-I{folder}", "main.c", "-lm", "-o", "main"]
    subprocess.run(command, cwd=tmp_path, check=True)
    done = subprocess.run([tmp_path / "main"], capture_output=True, text=True, check=True)
    functions = [
        lambda a, b, f=f: f(a) for f in (*ONE.values(), *SAFE.values(), lambda x: math.acosh(x + 1.0))
    ]
    functions += list(TWO.values())
    for f, call, line in zip(functions, calls, done.stdout.splitlines(), strict=True):

        def at(s, t, f=f):
            """Where the numbers are after s along the length and t along the seed."""
            return f(0.6 + s + 3.0 * t + 0.5 * s * t, 0.35 + 2.0 * s + t + 0.25 * s * t)

        expected = [
            extrapolated(lambda h: (at(h, 0.0) - at(-h, 0.0)) / (2.0 * h), 2e-3),
            extrapolated(lambda h: (at(0.0, h) - at(0.0, -h)) / (2.0 * h), 2e-3),
            extrapolated(lambda h: (at(h, h) - at(h, -h) - at(-h, h) + at(-h, -h)) / (4.0 * h * h), 2e-3),
        ]
        assert [float(v) for v in line.split()] == pytest.approx(expected, rel=1e-7, abs=1e-7), call
