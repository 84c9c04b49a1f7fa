/* Python's arithmetic in C99: the same numbers, and a fault where Python raises an exception.

   A translated function that can fail takes `int *py_fault`; the first fault stays, later values do not count. Whole
   numbers keep within +-2^53, so that each is exact as a double and no operation on them can overflow. */

#ifndef SEMANTICS_H
#define SEMANTICS_H

#include <math.h>
#include <stdint.h>
#include <string.h>

enum {
    PY_NO_FAULT,
    PY_DIVISION,   /* ZeroDivisionError */
    PY_DOMAIN,     /* ValueError: math domain error */
    PY_RANGE,      /* OverflowError: math range error */
    PY_INDEX,      /* IndexError */
    PY_CONVERSION, /* ValueError or OverflowError: no whole number, or one beyond 2^53 */
    PY_COMPLEX,    /* a negative number to a fractional power, which Python takes to the complex numbers */
    PY_UNSETTLED,  /* a loop of components without common start values */
    PY_REFUSED     /* this one and those above it: an input between two components is out of its bounds */
};

/* a new struct of these values: a compound literal in C, a list of them in C++ */
#ifdef __cplusplus
#define PY_NEW(type) type
#else
#define PY_NEW(type) (type)
#endif

#define PY_WHOLE_LIMIT 9007199254740992.0

enum { INPUT, OUTPUT, PARAMETER }; /* kinds of variables */

typedef struct {
    double *at;
    int64_t length;
} py_array;

static inline double py_raise(int kind, int *py_fault) {
    if (*py_fault == PY_NO_FAULT) {
        *py_fault = kind;
    }
    return 0.0;
}

/* Division and what follows from it */

static inline double py_divide(double a, double b, int *py_fault) {
    return b != 0.0 ? a / b : py_raise(PY_DIVISION, py_fault);
}

static inline double py_modulo(double a, double b, int *py_fault) {
    double rest;
    if (b == 0.0) {
        return py_raise(PY_DIVISION, py_fault);
    }
    rest = fmod(a, b);
    if (rest != 0.0) {
        return (b < 0.0) != (rest < 0.0) ? rest + b : rest;
    }
    return copysign(0.0, b);
}

static inline double py_floor_divide(double a, double b, int *py_fault) {
    double rest, quotient, whole;
    if (b == 0.0) {
        return py_raise(PY_DIVISION, py_fault);
    }
    rest = fmod(a, b);
    quotient = (a - rest) / b;
    if (rest != 0.0 && (b < 0.0) != (rest < 0.0)) {
        quotient -= 1.0;
    }
    if (quotient == 0.0) {
        return copysign(0.0, a / b);
    }
    whole = floor(quotient);
    return quotient - whole > 0.5 ? whole + 1.0 : whole;
}

static inline double py_power(double a, double b, int *py_fault) {
    double result;
    if (b == 0.0 || a == 1.0) {
        return 1.0;
    }
    if (isnan(a) || isnan(b)) {
        return a + b;
    }
    if (isfinite(a) && isfinite(b)) {
        if (a == 0.0 && b < 0.0) {
            return py_raise(PY_DIVISION, py_fault);
        }
        if (a < 0.0 && b != floor(b)) {
            return py_raise(PY_COMPLEX, py_fault);
        }
        result = pow(a, b);
        return isinf(result) ? py_raise(PY_RANGE, py_fault) : result;
    }
    return pow(a, b);
}

/* Whole numbers */

static inline int64_t py_bounded(int64_t a, int *py_fault) {
    if (a > (int64_t)PY_WHOLE_LIMIT || a < -(int64_t)PY_WHOLE_LIMIT) {
        py_raise(PY_CONVERSION, py_fault);
        return 0;
    }
    return a;
}

static inline int64_t py_whole(double a, int *py_fault) {
    if (fabs(a) <= PY_WHOLE_LIMIT) {
        return (int64_t)a;
    }
    py_raise(PY_CONVERSION, py_fault);
    return 0;
}

static inline int64_t py_plus(int64_t a, int64_t b, int *py_fault) {
    return py_bounded(a + b, py_fault);
}

static inline int64_t py_minus(int64_t a, int64_t b, int *py_fault) {
    return py_bounded(a - b, py_fault);
}

static inline int64_t py_times(int64_t a, int64_t b, int *py_fault) {
    return fabs((double)a * (double)b) <= PY_WHOLE_LIMIT ? a * b : py_whole(HUGE_VAL, py_fault);
}

static inline int64_t py_whole_floor_divide(int64_t a, int64_t b, int *py_fault) {
    if (b == 0) {
        py_raise(PY_DIVISION, py_fault);
        return 0;
    }
    return a / b - (a % b != 0 && (a % b < 0) != (b < 0));
}

static inline int64_t py_whole_modulo(int64_t a, int64_t b, int *py_fault) {
    if (b == 0) {
        py_raise(PY_DIVISION, py_fault);
        return 0;
    }
    return a % b + (a % b != 0 && (a % b < 0) != (b < 0) ? b : 0);
}

static inline int64_t py_whole_abs(int64_t a) { return a < 0 ? -a : a; }

/* Smallest and largest: the first of equal ones, and the first where a NaN compares false */

static inline double py_min(double a, double b) { return b < a ? b : a; }
static inline double py_max(double a, double b) { return b > a ? b : a; }
static inline int64_t py_whole_min(int64_t a, int64_t b) { return b < a ? b : a; }
static inline int64_t py_whole_max(int64_t a, int64_t b) { return b > a ? b : a; }

/* The module math: a NaN that no argument brought is a domain error, an infinity a range error (or one of the domain) */

static inline double py_result(double y, double x, int infinite, int *py_fault) {
    if (isnan(y)) {
        return isnan(x) ? y : py_raise(PY_DOMAIN, py_fault);
    }
    return isinf(y) && isfinite(x) ? py_raise(infinite, py_fault) : y;
}

#define PY_MATH(name, infinite) \
    static inline double py_##name(double x, int *py_fault) { return py_result(name(x), x, infinite, py_fault); }

PY_MATH(acos, PY_DOMAIN)
PY_MATH(acosh, PY_DOMAIN)
PY_MATH(asin, PY_DOMAIN)
PY_MATH(atanh, PY_DOMAIN)
PY_MATH(cos, PY_DOMAIN)
PY_MATH(cosh, PY_RANGE)
PY_MATH(exp, PY_RANGE)
PY_MATH(expm1, PY_RANGE)
PY_MATH(log, PY_DOMAIN)
PY_MATH(log10, PY_DOMAIN)
PY_MATH(log1p, PY_DOMAIN)
PY_MATH(log2, PY_DOMAIN)
PY_MATH(sin, PY_DOMAIN)
PY_MATH(sinh, PY_RANGE)
PY_MATH(sqrt, PY_DOMAIN)
PY_MATH(tan, PY_DOMAIN)

static inline double py_fmod(double a, double b, int *py_fault) {
    if (isfinite(a) && isinf(b)) {
        return a;
    }
    return b == 0.0 || isinf(a) ? py_raise(PY_DOMAIN, py_fault) : fmod(a, b);
}

/* Python's floor, ceil, trunc and round give whole numbers of any size: kept as doubles, and never a negative zero */

#define PY_ROUNDING(name, function) \
    static inline double py_##name(double x, int *py_fault) { \
        return isfinite(x) ? function(x) + 0.0 : py_raise(PY_CONVERSION, py_fault); \
    }

PY_ROUNDING(floor, floor)
PY_ROUNDING(ceil, ceil)
PY_ROUNDING(trunc, trunc)
PY_ROUNDING(round, rint)

/* Lists of numbers; a negative index counts from the end */

static inline double *py_element(py_array a, int64_t i, int *py_fault) {
    if (i < 0) {
        i += a.length;
    }
    if (i < 0 || i >= a.length) {
        py_raise(PY_INDEX, py_fault);
        return 0;
    }
    return a.at + i;
}

static inline double py_get(py_array a, int64_t i, int *py_fault) {
    const double *element = py_element(a, i, py_fault);
    return element ? *element : 0.0;
}

static inline void py_set(py_array a, int64_t i, double value, int *py_fault) {
    double *element = py_element(a, i, py_fault);
    if (element) {
        *element = value;
    }
}

#endif
