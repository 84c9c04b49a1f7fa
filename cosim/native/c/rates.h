/* Numbers with derivatives, for model exchange: y' follows from a step of length 0 whose derivative by the length is taken.

   A number stands for a value, its derivative by the length (rate), its derivative in a direction of inputs and states (seed),
   and the derivative of the one by the other (both). Products, quotients and functions obey the rules of differentiation,
   exactly and without a difference of close values (Fike and Alonso, The development of hyper-dual numbers for exact
   second-derivative calculations, AIAA 2011-886). Plain structs and functions, so that any compiler takes them. */

#ifndef RATES_H
#define RATES_H

typedef struct {
    double value, rate, seed, both;
} py_dual;

static inline py_dual pc_make(double value, double rate, double seed, double both) {
    py_dual z;
    z.value = value;
    z.rate = rate;
    z.seed = seed;
    z.both = both;
    return z;
}

static inline py_dual pc_real(double value) { return pc_make(value, 0.0, 0.0, 0.0); }
static inline double pc_value(py_dual z) { return z.value; }

static inline py_dual pc_plus(py_dual a, py_dual b) {
    return pc_make(a.value + b.value, a.rate + b.rate, a.seed + b.seed, a.both + b.both);
}

static inline py_dual pc_minus(py_dual a, py_dual b) {
    return pc_make(a.value - b.value, a.rate - b.rate, a.seed - b.seed, a.both - b.both);
}

static inline py_dual pc_negative(py_dual a) { return pc_make(-a.value, -a.rate, -a.seed, -a.both); }

static inline py_dual pc_times(py_dual a, py_dual b) {
    return pc_make(a.value * b.value, a.value * b.rate + a.rate * b.value, a.value * b.seed + a.seed * b.value,
                   a.value * b.both + a.rate * b.seed + a.seed * b.rate + a.both * b.value);
}

/* q = a / b from q at its value; b is not 0 */
static inline py_dual pc_quotient(double q, py_dual a, py_dual b) {
    const double rate = (a.rate - q * b.rate) / b.value, seed = (a.seed - q * b.seed) / b.value;
    return pc_make(q, rate, seed, (a.both - rate * b.seed - seed * b.rate - q * b.both) / b.value);
}

static inline py_dual pc_over(py_dual a, py_dual b) { return pc_quotient(a.value / b.value, a, b); }

/* A factor that may be infinite where nothing moves */
static inline double pc_part(double factor, double change) { return change != 0.0 ? factor * change : 0.0; }

/* f(z) from f and its first two derivatives at its value */
static inline py_dual pc_function(py_dual z, double y, double slope, double curve) {
    return pc_make(y, pc_part(slope, z.rate), pc_part(slope, z.seed),
                   pc_part(slope, z.both) + pc_part(curve, z.rate * z.seed));
}

/* slope d and curve of a function of x whose value is y */
#define PC_MATH(name, result, slope, curve) \
    static inline py_dual pc_##name(py_dual z, int *py_fault) { \
        const double x = z.value, y = result, d = slope; \
        (void)x; \
        return pc_function(z, y, d, curve); \
    }

PC_MATH(acos, py_acos(x, py_fault), -1.0 / sqrt(1.0 - x * x), d * x / (1.0 - x * x))
PC_MATH(acosh, py_acosh(x, py_fault), 1.0 / sqrt(x * x - 1.0), -d * x / (x * x - 1.0))
PC_MATH(asin, py_asin(x, py_fault), 1.0 / sqrt(1.0 - x * x), d * x / (1.0 - x * x))
PC_MATH(atanh, py_atanh(x, py_fault), 1.0 / (1.0 - x * x), 2.0 * x * d * d)
PC_MATH(cos, py_cos(x, py_fault), -sin(x), -y)
PC_MATH(cosh, py_cosh(x, py_fault), sinh(x), y)
PC_MATH(exp, py_exp(x, py_fault), y, y)
PC_MATH(expm1, py_expm1(x, py_fault), y + 1.0, y + 1.0)
PC_MATH(log, py_log(x, py_fault), 1.0 / x, -d * d)
PC_MATH(log10, py_log10(x, py_fault), 1.0 / (x * log(10.0)), -d / x)
PC_MATH(log1p, py_log1p(x, py_fault), 1.0 / (1.0 + x), -d * d)
PC_MATH(log2, py_log2(x, py_fault), 1.0 / (x * log(2.0)), -d / x)
PC_MATH(sin, py_sin(x, py_fault), cos(x), -y)
PC_MATH(sinh, py_sinh(x, py_fault), cosh(x), y)
PC_MATH(sqrt, py_sqrt(x, py_fault), 0.5 / y, -d * d / y)
PC_MATH(tan, py_tan(x, py_fault), 1.0 + y * y, 2.0 * y * d)
PC_MATH(floor, py_floor(x, py_fault), 0.0, 0.0)
PC_MATH(ceil, py_ceil(x, py_fault), 0.0, 0.0)
PC_MATH(trunc, py_trunc(x, py_fault), 0.0, 0.0)
PC_MATH(round, py_round(x, py_fault), 0.0, 0.0)

#define PC_SAFE(name, slope, curve) \
    static inline py_dual pc_##name(py_dual z) { \
        const double x = z.value, y = name(x), d = slope; \
        return pc_function(z, y, d, curve); \
    }

PC_SAFE(fabs, copysign(1.0, x), 0.0)
PC_SAFE(tanh, 1.0 - y * y, -2.0 * y * d)
PC_SAFE(atan, 1.0 / (1.0 + x * x), -2.0 * x * d * d)
PC_SAFE(asinh, 1.0 / sqrt(1.0 + x * x), -x * d * d * d)
PC_SAFE(erf, 1.1283791670955126 * exp(-x * x), -2.0 * x * d)
PC_SAFE(erfc, -1.1283791670955126 * exp(-x * x), -2.0 * x * d)

/* f(a, b) from f and its derivatives by a, b, a a, b b and a b */
static inline py_dual pc_function2(py_dual a, py_dual b, double y, double da, double db, double daa, double dbb, double dab) {
    return pc_make(y, pc_part(da, a.rate) + pc_part(db, b.rate), pc_part(da, a.seed) + pc_part(db, b.seed),
                   pc_part(da, a.both) + pc_part(db, b.both) + pc_part(daa, a.rate * a.seed) +
                       pc_part(dbb, b.rate * b.seed) + pc_part(dab, a.rate * b.seed + a.seed * b.rate));
}

static inline py_dual pc_atan2(py_dual a, py_dual b) {
    const double y = a.value, x = b.value, s = y * y + x * x, w = s > 0.0 ? 1.0 / s : 0.0;
    return pc_function2(a, b, atan2(y, x), x * w, -y * w, -2.0 * x * y * w * w, 2.0 * x * y * w * w, (y * y - x * x) * w * w);
}

static inline py_dual pc_copysign(py_dual a, py_dual b) {
    return signbit(a.value) == signbit(b.value) ? a : pc_negative(a);
}

static inline py_dual pc_divide(py_dual a, py_dual b, int *py_fault) {
    const double value = py_divide(a.value, b.value, py_fault);
    return b.value != 0.0 ? pc_quotient(value, a, b) : pc_real(value);
}

/* what is left of a after whole times b, a whole number that does not move */
static inline py_dual pc_rest(double value, double whole, py_dual a, py_dual b) {
    return pc_make(value, a.rate - whole * b.rate, a.seed - whole * b.seed, a.both - whole * b.both);
}

static inline py_dual pc_modulo(py_dual a, py_dual b, int *py_fault) {
    const double whole = py_floor_divide(a.value, b.value, py_fault);
    return pc_rest(py_modulo(a.value, b.value, py_fault), whole, a, b);
}

static inline py_dual pc_fmod(py_dual a, py_dual b, int *py_fault) {
    const double rest = py_fmod(a.value, b.value, py_fault);
    return pc_rest(rest, b.value != 0.0 ? (a.value - rest) / b.value : 0.0, a, b);
}

static inline py_dual pc_floor_divide(py_dual a, py_dual b, int *py_fault) {
    return pc_real(py_floor_divide(a.value, b.value, py_fault));
}

static inline py_dual pc_power(py_dual a, py_dual b, int *py_fault) {
    const double x = a.value, n = b.value, y = py_power(x, n, py_fault), l = x > 0.0 ? log(x) : 0.0;
    const double da = n != 0.0 ? n * pow(x, n - 1.0) : 0.0;
    const double daa = n != 0.0 && n != 1.0 ? n * (n - 1.0) * pow(x, n - 2.0) : 0.0;
    return pc_function2(a, b, y, da, y * l, daa, y * l * l, x > 0.0 ? pow(x, n - 1.0) * (1.0 + n * l) : 0.0);
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
