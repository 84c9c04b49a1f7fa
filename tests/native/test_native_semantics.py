"""Translated functions compute what Python computes, bit for bit, and fail where Python raises."""

import itertools
import math

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from native_bench import Library, translated

from cosim.errors import ModelError
from cosim.native.kinds import ARRAY, REAL
from cosim.native.translate import Program
from fmus import registry
from fmus.compose import compose
from fmus.contract import Effect, Variable, equation

# functions of two numbers, written as an author of effects might


def modulo(a, b):
    return a % b


def floor_divide(a, b):
    return a // b


def divide(a, b):
    return a / b


def power(a, b):
    return a**b


def smallest(a, b):
    return min(a, b, 1.5)


def largest(a, b):
    return max(a, -b)


def rounding(a, b):
    return math.floor(a) - math.ceil(b) + math.trunc(a) * 2 + round(b)


def roots(a, b):
    return math.sqrt(a) + math.log(b)


def exponentials(a, b):
    return math.exp(a) - math.expm1(b) + math.tanh(a)


def angles(a, b):
    return math.sin(a) + math.cos(b) + math.tan(a) + math.atan2(a, b)


def others(a, b):
    return (
        math.asin(a) + math.acosh(b) + math.log1p(a) + math.sinh(b) + math.fmod(a, b) + math.copysign(1.0, a)
    )


def whole(a, b):
    i = int(a)
    k = i - 3
    j = (7 * i + k) // 5 % 11
    return float(i) + j / 4 + abs(k) + (-7) // 2 + (-7) % 5 + b * 0


def chained(a, b):
    if -1.0 < a <= b < 10:
        return 1.0
    elif not (a == b) and (a > 2.0 or b > 2.0):  # noqa: RET505, SIM201
        return 2
    return 3.0


def precedence(a, b):
    return -(a - (b - a)) - -b / 2.0 * -(a / 4.0) - (a * b - (a + b)) / (2.0 - 0.5)


def loop(a, b):
    total = 0.0
    for k in range(1, 12):
        if k == 4:
            continue
        if total > b:
            break
        total += a / k
    n = 0
    while n < 5 and total < 100.0:
        n += 1
        total = total * 1.5 + n
    return total + k


def pair(a, b):
    return a + b, a - b


def swapping(a, b):
    a, b = b, a
    c, _ = pair(a, b)
    (d, e) = (c, a) if c > 0.0 else (a, c)
    return d - 2.0 * e + b


def late(a, b):
    if a > 0.0:
        x = 1
        y = b
    else:
        x = a
        y = 2
    x += y
    return x


def ternary(a, b):
    return (1 if a > b else a) * (b if a != 0.0 and b / a > 1.0 else 2)


def truth(a, b):
    flag = a > b
    return flag + 1 if a else bool(b) * 2.5


PAIRS = (
    modulo, floor_divide, divide, power, smallest, largest, rounding, roots, exponentials, angles, others, whole, chained,
    precedence, loop, swapping, late, ternary, truth,
)  # fmt: skip


def element(ring, at):
    i = int(at)
    ring[i] = ring[i - 1] + 1.0
    ring[0] += 0.5
    return ring[-1] + ring[i] * len(ring)


# Python has one exception where a conversion fails and where the domain ends; a whole number beyond 2^53 fails later there,
# and a complex power may overflow
SAME = {"PY_CONVERSION": {"PY_DOMAIN", "PY_RANGE", "PY_INDEX"}, "PY_COMPLEX": {"PY_RANGE"}}
NUMBERS = st.one_of(
    st.floats(-100.0, 100.0),
    st.integers(-12, 12).map(float),
    st.floats(),
    st.sampled_from([0.0, -0.0, math.inf, -math.inf, math.nan, 0.5, -0.5, 1.5, 2.5, 5e-324, 1e308, 2.0**53]),
)
KINDS = {
    ZeroDivisionError: "PY_DIVISION",
    OverflowError: "PY_RANGE",
    ValueError: "PY_DOMAIN",
    IndexError: "PY_INDEX",
}


@pytest.fixture(scope="module")
def library(tmp_path_factory):
    kinds = {f.__name__: (REAL, REAL) for f in PAIRS} | {"element": (ARRAY, REAL)}
    texts = [t for f in PAIRS for t in translated(f, (REAL, REAL), [pair])]
    return Library(tmp_path_factory.mktemp("semantics"), [*texts, *translated(element, (ARRAY, REAL))], kinds)


def expected(function, *values):
    """Python's result, or the fault that stands for its exception."""
    try:
        result = function(*values)
    except (ArithmeticError, ValueError, IndexError) as error:
        return None, KINDS[type(error)]
    return (None, "PY_COMPLEX") if isinstance(result, complex) else (float(result), "PY_NO_FAULT")


@pytest.mark.parametrize("function", PAIRS, ids=lambda f: f.__name__)
@settings(max_examples=150, deadline=None)
@example(a=-7.0, b=5.0)
@example(a=7.0, b=-5.0)
@example(a=-8.0, b=1.0 / 3.0)
@example(a=0.0, b=-1.0)
@example(a=6.0, b=-0.0)
@given(a=NUMBERS, b=NUMBERS)
def test_a_function_of_two_numbers(library, function, a, b) -> None:
    if function in (whole, rounding) and any(2.0**49 < abs(v) < math.inf for v in (a, b)):
        return  # Python's whole numbers stay exact beyond what a double holds; ours are refused or rounded
    wanted, fault = expected(function, a, b)
    found, raised = library.call(function.__name__, a, b)
    assert raised == fault or fault in SAME.get(raised, ())
    if fault == "PY_NO_FAULT":
        assert found == wanted or (math.isnan(found) and math.isnan(wanted))
        if function is modulo or function is floor_divide:
            assert math.copysign(1.0, found) == math.copysign(1.0, wanted) or math.isnan(found)


@settings(max_examples=200, deadline=None)
@given(st.lists(st.floats(-5.0, 5.0), min_size=1, max_size=6), NUMBERS)
def test_elements_of_a_list(library, ring, at) -> None:
    """A negative place counts from the end, one beyond it is a fault, and the list is changed in place."""
    own, other = list(ring), list(ring)
    wanted, fault = expected(element, own, at)
    found, raised = library.call("element", other, at)
    assert raised == fault or fault in SAME.get(raised, ())
    if fault == "PY_NO_FAULT":
        assert (found, other) == (wanted, own)


# What cannot be translated is refused with the function's name and the line


@equation
def with_text(theta, m, p):
    return theta + len("abc") * p.trial


@equation
def with_list(theta, m, p):
    return sum([theta, p.trial])


@equation
def with_keyword(theta, m, p):
    return max(theta, p.trial, key=abs)


@equation
def with_unknown(theta, m, p):
    return math.gamma(theta) * p.trial


@equation
def with_truth_of_numbers(theta, m, p):
    return theta or p.trial


@equation
def with_real_place(theta, m, p):
    ring = (theta, p.trial)
    return ring[int(theta)]


@equation  # noqa: RET503
def with_no_end(theta, m, p):
    if theta > p.trial:
        return theta


@equation
def with_mixed(theta, m, p):
    value = theta
    value = (theta, p.trial)
    return value[0]


@equation
def with_itself(theta, m, p):
    return with_itself(theta - 1.0, m, p) if theta > p.trial else theta


@equation
def with_early_use(theta, m, p):
    return theta + later  # noqa: F821


REFUSALS = {
    with_text: "'abc' is no number",
    with_list: "function with_list: line 'return sum",
    with_keyword: "arguments must be given by place",
    with_unknown: "'math.gamma' is not supported",
    with_truth_of_numbers: "compare each number",
    with_real_place: "must be a written number",
    with_no_end: "may end without returning a value",
    with_mixed: "'value' is a number and a tuple of 2",
    with_itself: "with_itself calls itself",
    with_early_use: "'later' has no value here",
}


@pytest.mark.parametrize("fill", REFUSALS, ids=lambda f: f.__name__)
def test_what_cannot_be_translated_is_refused(fill) -> None:
    trial = Effect(
        name="sensor.trial", text="t", residual="t", source="t", key="trial", fills={"sensed_angle": fill},
        parameters={"trial": Variable("1", "size", source="test")},
    )  # fmt: skip
    with pytest.raises(
        ModelError, match=r"block 'sensor' with sensor\.trial cannot be translated"
    ) as refusal:
        Program(compose(registry.block("sensor"), [trial]), "sensor_")
    assert REFUSALS[fill] in str(refusal.value)
    assert fill.__name__ in str(refusal.value)


def test_every_name_in_c_is_one(tmp_path) -> None:
    """Words of C, names of its library and Greek letters are names in Python."""

    def names(double, θ):
        register = double + 1.0
        sin = θ
        exp, py_x = register * sin, 2.0
        return math.sin(exp) - py_x * math.exp(sin)

    found = Library(tmp_path, translated(names, (REAL, REAL)), {"names": (REAL, REAL)})
    for a, b in itertools.product((-1.0, 0.3), (0.0, 2.0)):
        assert found.call("names", a, b)[0] == names(a, b)
