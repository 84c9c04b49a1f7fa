"""Exact solutions of small linear systems, shared by the blocks.

The phi functions and the 2x2 matrix exponential are standard (Higham, Functions of Matrices, 2008, ch. 10).
"""

import math

from fmus.contract import equation


@equation
def phi_functions(a: float) -> tuple[float, float, float, float]:
    """exp(-a), phi1, phi2, phi3 of -a, with phi1 = (1 - exp(-a))/a, phi2 = (1 - phi1)/a, phi3 = (1/2 - phi2)/a; a >= 0.

    They integrate y' = -(a/h) y + constant or ramp over a step h exactly; a = 0 is no special case.
    """
    if a < 1.0:
        # downwards from the series of phi3: the upward form cancels for small a
        term = 1.0 / 6.0
        phi3 = term
        k = 4.0
        while k < 22.0:
            term = -term * a / k
            phi3 += term
            k += 1.0
        phi2 = 0.5 - a * phi3
        phi1 = 1.0 - a * phi2
        return 1.0 - a * phi1, phi1, phi2, phi3
    decay = math.exp(-a)
    phi1 = (1.0 - decay) / a
    phi2 = (1.0 - phi1) / a
    phi3 = (0.5 - phi2) / a
    return decay, phi1, phi2, phi3


@equation
def expm2(m11: float, m12: float, m21: float, m22: float, t: float) -> tuple[float, float, float, float]:
    """The four entries of exp(M t) of a real 2x2 matrix M, row by row, in closed form."""
    mean = 0.5 * (m11 + m22)
    d11 = m11 - mean
    d22 = m22 - mean
    square = d11 * d11 + m12 * m21  # of half the distance of the two eigenvalues
    if square > 0.0:
        # the faster-growing exponential is taken out, so that a strongly damped pair cannot overflow
        root = math.sqrt(square)
        mean = mean + root
        c = 0.5 * (1.0 + math.exp(-2.0 * root * t))
        s = -0.5 * math.expm1(-2.0 * root * t) / root
    elif square < 0.0:
        root = math.sqrt(-square)
        c = math.cos(root * t)
        s = math.sin(root * t) / root
    else:
        c = 1.0
        s = t
    scale = math.exp(mean * t)
    return scale * (c + s * d11), scale * s * m12, scale * s * m21, scale * (c + s * d22)


@equation
def held_pair(a1: float, a0: float, h: float) -> tuple[float, float]:
    """Response after h from rest of x'' + a1 x' + a0 x = 1, and its rate; a1, a0 >= 0.

    From them follows exp of the companion matrix: its columns are (1 - a0 s, -a0 r) and (r, 1 - a0 s - a1 r).
    """
    size = (a1 + math.sqrt(a0)) * h
    t = h
    halvings = 0.0
    while size > 0.25:
        size = 0.5 * size
        t = 0.5 * t
        halvings += 1.0
    # the power series of x: c2 = 1/2, (j + 2)(j + 1) c(j+2) = -a0 c(j) - a1 (j + 1) c(j+1)
    before = 0.0
    here = 0.5
    power = t
    s = 0.0
    r = 0.0
    j = 2.0
    while j < 16.0:
        r += j * here * power
        power *= t
        s += here * power
        following = -(a0 * before + a1 * j * here) / ((j + 1.0) * j)
        before = here
        here = following
        j += 1.0
    while halvings > 0.0:
        doubled = s + (1.0 - a0 * s) * s + r * r
        r = r + (1.0 - a0 * s - a1 * r) * r - a0 * r * s
        s = doubled
        halvings -= 1.0
    return s, r
