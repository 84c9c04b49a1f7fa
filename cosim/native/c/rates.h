/* Numbers with a derivative, for model exchange: y' follows from a step of length 0 whose derivative by the length is taken.

   A number a + b i stands for the value a and the derivative b SEED: with SEED so small that b b vanishes, products and
   quotients of complex numbers obey the rules of differentiation, exactly and without a difference of close values (Squire
   and Trapp, Using complex variables to estimate derivatives, SIAM Review 40, 1998). */

#ifndef RATES_H
#define RATES_H

#include <complex.h>
#undef I /* the instance's name elsewhere */

#define SEED 1e-180

typedef double complex py_complex;

static inline py_complex pc_make(double value, double derivative) {
    const double parts[2] = {value, derivative};
    py_complex z;
    memcpy(&z, parts, sizeof z);
    return z;
}

/* f(z) from f and f' at its value */
#define PC_MATH(name, value, slope) \
    static inline py_complex pc_##name(py_complex z, int *py_fault) { \
        const double x = creal(z), y = value; \
        return pc_make(y, cimag(z) != 0.0 ? cimag(z) * (slope) : 0.0); \
    }

PC_MATH(acos, py_acos(x, py_fault), -1.0 / sqrt(1.0 - x * x))
PC_MATH(acosh, py_acosh(x, py_fault), 1.0 / sqrt(x * x - 1.0))
PC_MATH(asin, py_asin(x, py_fault), 1.0 / sqrt(1.0 - x * x))
PC_MATH(atanh, py_atanh(x, py_fault), 1.0 / (1.0 - x * x))
PC_MATH(cos, py_cos(x, py_fault), -sin(x))
PC_MATH(cosh, py_cosh(x, py_fault), sinh(x))
PC_MATH(exp, py_exp(x, py_fault), y)
PC_MATH(expm1, py_expm1(x, py_fault), y + 1.0)
PC_MATH(log, py_log(x, py_fault), 1.0 / x)
PC_MATH(log10, py_log10(x, py_fault), 1.0 / (x * log(10.0)))
PC_MATH(log1p, py_log1p(x, py_fault), 1.0 / (1.0 + x))
PC_MATH(log2, py_log2(x, py_fault), 1.0 / (x * log(2.0)))
PC_MATH(sin, py_sin(x, py_fault), cos(x))
PC_MATH(sinh, py_sinh(x, py_fault), cosh(x))
PC_MATH(sqrt, py_sqrt(x, py_fault), 0.5 / y)
PC_MATH(tan, py_tan(x, py_fault), 1.0 + y * y)
PC_MATH(floor, py_floor(x, py_fault), 0.0)
PC_MATH(ceil, py_ceil(x, py_fault), 0.0)
PC_MATH(trunc, py_trunc(x, py_fault), 0.0)
PC_MATH(round, py_round(x, py_fault), 0.0)

#define PC_SAFE(name, slope) \
    static inline py_complex pc_##name(py_complex z) { \
        const double x = creal(z), y = name(x); \
        return pc_make(y, cimag(z) != 0.0 ? cimag(z) * (slope) : 0.0); \
    }

PC_SAFE(fabs, copysign(1.0, x) + 0.0 * y)
PC_SAFE(tanh, 1.0 - y * y)
PC_SAFE(atan, 1.0 / (1.0 + x * x) + 0.0 * y)
PC_SAFE(asinh, 1.0 / sqrt(1.0 + x * x) + 0.0 * y)
PC_SAFE(erf, 1.1283791670955126 * exp(-x * x) + 0.0 * y)
PC_SAFE(erfc, -1.1283791670955126 * exp(-x * x) + 0.0 * y)

static inline py_complex pc_atan2(py_complex y, py_complex x) {
    const double a = creal(y), b = creal(x), square = a * a + b * b;
    return pc_make(atan2(a, b), square > 0.0 ? (b * cimag(y) - a * cimag(x)) / square : 0.0);
}

static inline py_complex pc_copysign(py_complex a, py_complex b) {
    const double flip = signbit(creal(a)) == signbit(creal(b)) ? 1.0 : -1.0;
    return pc_make(flip * creal(a), flip * cimag(a));
}

static inline py_complex pc_divide(py_complex a, py_complex b, int *py_fault) {
    const double value = py_divide(creal(a), creal(b), py_fault);
    return pc_make(value, creal(b) != 0.0 ? (cimag(a) - value * cimag(b)) / creal(b) : 0.0);
}

static inline py_complex pc_modulo(py_complex a, py_complex b, int *py_fault) {
    const double whole = py_floor_divide(creal(a), creal(b), py_fault);
    return pc_make(py_modulo(creal(a), creal(b), py_fault), cimag(a) - whole * cimag(b));
}

static inline py_complex pc_fmod(py_complex a, py_complex b, int *py_fault) {
    const double rest = py_fmod(creal(a), creal(b), py_fault);
    return pc_make(rest, cimag(a) - (creal(b) != 0.0 ? (creal(a) - rest) / creal(b) : 0.0) * cimag(b));
}

static inline py_complex pc_floor_divide(py_complex a, py_complex b, int *py_fault) {
    return pc_make(py_floor_divide(creal(a), creal(b), py_fault), 0.0);
}

static inline py_complex pc_power(py_complex a, py_complex b, int *py_fault) {
    const double x = creal(a), n = creal(b), y = py_power(x, n, py_fault);
    double slope = 0.0;
    if (cimag(a) != 0.0 && n != 0.0) {
        slope += cimag(a) * n * pow(x, n - 1.0);
    }
    if (cimag(b) != 0.0 && x > 0.0) {
        slope += cimag(b) * y * log(x);
    }
    return pc_make(y, slope);
}

static inline int64_t pc_whole(py_complex a, int *py_fault) { return py_whole(creal(a), py_fault); }
static inline py_complex pc_min(py_complex a, py_complex b) { return creal(b) < creal(a) ? b : a; }
static inline py_complex pc_max(py_complex a, py_complex b) { return creal(b) > creal(a) ? b : a; }
static inline int pc_isnan(py_complex a) { return isnan(creal(a)); }
static inline int pc_isinf(py_complex a) { return isinf(creal(a)); }
static inline int pc_isfinite(py_complex a) { return isfinite(creal(a)); }

#endif
