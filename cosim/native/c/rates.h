/* Numbers with a derivative, for model exchange: y' follows from a step of length 0 whose derivative by the length is taken.

   A number stands for a value and a derivative; products, quotients and functions obey the rules of differentiation, exactly
   and without a difference of close values (forward mode of automatic differentiation: Wengert, A simple automatic derivative
   evaluation program, Comm. ACM 7(8), 1964). Plain structs and functions, so that any compiler takes them. */

#ifndef RATES_H
#define RATES_H

typedef struct {
    double value, rate;
} py_dual;

static inline py_dual pc_make(double value, double rate) {
    py_dual z;
    z.value = value;
    z.rate = rate;
    return z;
}

static inline py_dual pc_real(double value) { return pc_make(value, 0.0); }
static inline double pc_value(py_dual z) { return z.value; }

static inline py_dual pc_plus(py_dual a, py_dual b) { return pc_make(a.value + b.value, a.rate + b.rate); }
static inline py_dual pc_minus(py_dual a, py_dual b) { return pc_make(a.value - b.value, a.rate - b.rate); }
static inline py_dual pc_negative(py_dual a) { return pc_make(-a.value, -a.rate); }

static inline py_dual pc_times(py_dual a, py_dual b) {
    return pc_make(a.value * b.value, a.value * b.rate + a.rate * b.value);
}

/* by a number that is not 0 */
static inline py_dual pc_over(py_dual a, py_dual b) {
    const double value = a.value / b.value;
    return pc_make(value, (a.rate - value * b.rate) / b.value);
}

/* f(z) from f and f' at its value */
#define PC_MATH(name, result, slope) \
    static inline py_dual pc_##name(py_dual z, int *py_fault) { \
        const double x = z.value, y = result; \
        return pc_make(y, z.rate != 0.0 ? z.rate * (slope) : 0.0); \
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
    static inline py_dual pc_##name(py_dual z) { \
        const double x = z.value, y = name(x); \
        return pc_make(y, z.rate != 0.0 ? z.rate * (slope) : 0.0); \
    }

PC_SAFE(fabs, copysign(1.0, x) + 0.0 * y)
PC_SAFE(tanh, 1.0 - y * y)
PC_SAFE(atan, 1.0 / (1.0 + x * x) + 0.0 * y)
PC_SAFE(asinh, 1.0 / sqrt(1.0 + x * x) + 0.0 * y)
PC_SAFE(erf, 1.1283791670955126 * exp(-x * x) + 0.0 * y)
PC_SAFE(erfc, -1.1283791670955126 * exp(-x * x) + 0.0 * y)

static inline py_dual pc_atan2(py_dual y, py_dual x) {
    const double a = y.value, b = x.value, square = a * a + b * b;
    return pc_make(atan2(a, b), square > 0.0 ? (b * y.rate - a * x.rate) / square : 0.0);
}

static inline py_dual pc_copysign(py_dual a, py_dual b) {
    const double flip = signbit(a.value) == signbit(b.value) ? 1.0 : -1.0;
    return pc_make(flip * a.value, flip * a.rate);
}

static inline py_dual pc_divide(py_dual a, py_dual b, int *py_fault) {
    const double value = py_divide(a.value, b.value, py_fault);
    return pc_make(value, b.value != 0.0 ? (a.rate - value * b.rate) / b.value : 0.0);
}

static inline py_dual pc_modulo(py_dual a, py_dual b, int *py_fault) {
    const double whole = py_floor_divide(a.value, b.value, py_fault);
    return pc_make(py_modulo(a.value, b.value, py_fault), a.rate - whole * b.rate);
}

static inline py_dual pc_fmod(py_dual a, py_dual b, int *py_fault) {
    const double rest = py_fmod(a.value, b.value, py_fault);
    return pc_make(rest, a.rate - (b.value != 0.0 ? (a.value - rest) / b.value : 0.0) * b.rate);
}

static inline py_dual pc_floor_divide(py_dual a, py_dual b, int *py_fault) {
    return pc_make(py_floor_divide(a.value, b.value, py_fault), 0.0);
}

static inline py_dual pc_power(py_dual a, py_dual b, int *py_fault) {
    const double x = a.value, n = b.value, y = py_power(x, n, py_fault);
    double slope = 0.0;
    if (a.rate != 0.0 && n != 0.0) {
        slope += a.rate * n * pow(x, n - 1.0);
    }
    if (b.rate != 0.0 && x > 0.0) {
        slope += b.rate * y * log(x);
    }
    return pc_make(y, slope);
}

static inline int64_t pc_whole(py_dual a, int *py_fault) { return py_whole(a.value, py_fault); }
static inline py_dual pc_min(py_dual a, py_dual b) { return b.value < a.value ? b : a; }
static inline py_dual pc_max(py_dual a, py_dual b) { return b.value > a.value ? b : a; }
static inline int pc_isnan(py_dual a) { return isnan(a.value); }
static inline int pc_isinf(py_dual a) { return isinf(a.value); }
static inline int pc_isfinite(py_dual a) { return isfinite(a.value); }

static inline py_dual pc_get(py_array a, int64_t i, int *py_fault) { return pc_real(py_get(a, i, py_fault)); }
static inline void pc_set(py_array a, int64_t i, py_dual value, int *py_fault) { py_set(a, i, value.value, py_fault); }

#endif
