/* One instance: its values, its phase of life, what it says when it refuses something, and a number as Python writes it. */

#ifndef INSTANCE_H
#define INSTANCE_H

#include <locale.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>

#define NUMBER_SIZE 40
#define ORDERS 3 /* highest order of an input's derivative */
#define TIME (N_VARIABLES + 2 * N_STATES) /* value reference of the time, in FMI 3.0, and then of event indicators */

enum { INSTANTIATED, INITIALISING, RUNNING, TERMINATED };

/* What FMI 2.0 and 3.0 share: the numbers of statuses, and the type of value references. */
typedef enum { STATUS_OK, STATUS_DISCARD = 2, STATUS_ERROR = 3 } Status;
typedef uint32_t Reference;

/* Who is told of errors. */
typedef struct {
    void *environment;
    void (*logger)(void); /* of the type that its version of FMI gives it */
} Host;

typedef struct {
    char *name;
    char *resources; /* folder of the FMU's resources */
    Host host;
    int exchange; /* for model exchange, not co-simulation */
    int mode;
    int failed;  /* something was refused: no step until a reset or a good state */
    int begun;   /* state and outputs follow from the values as they are */
    double time; /* at which the simulation starts, then of the last step's end */
    double step; /* that the coefficients belong to */
    double motion; /* between two events of model exchange, by the model's own numbers */
    double values[N_VARIABLES];
    int slopes; /* an input's derivative is set for the next step, which FMI 2.0 alone allows */
    double derivatives[N_INPUTS + 1][ORDERS];
    Model model;
    double begun_at, samples; /* of what is sampled in model exchange: its start, and the number of the next sample */
    double held[N_INPUTS + 1]; /* its inputs at the last sample */
} Instance;

/* The next number up, in size, of as many digits. */
static void raise_digits(char *digits) {
    char *exponent = strchr(digits, 'e'), *at = exponent - 1;
    int e = atoi(exponent + 1);
    for (; at >= digits; at--) { /* a sign and what the locale puts between the digits stay */
        if (*at == '9') {
            *at = '0';
        } else if (*at >= '0' && *at < '9') {
            ++*at;
            return;
        }
    }
    for (at = digits; *at < '0' || *at > '9'; at++) {
    }
    *at = '1'; /* 9.9 became 0.0: it is 10 */
    sprintf(exponent, "e%+03d", e + 1);
}

/* The shortest text that reads back as the same number, in Python's form: 1e-06, 0.25, 100000000000.0 */
static const char *number(double value, char text[NUMBER_SIZE]) {
    char digits[NUMBER_SIZE], *exponent;
    int precision, e, n, k;
    char *at = text;
    if (value != value || value - value != 0.0) {
        return strcpy(text, value != value ? "nan" : value > 0.0 ? "inf" : "-inf");
    }
    for (precision = 0; precision < 17; precision++) {
        snprintf(digits, sizeof digits, "%.*e", precision, value);
        if (strtod(digits, NULL) == value) {
            break;
        }
        raise_digits(digits); /* above a power of two there is twice the room: the second nearest may read back */
        if (strtod(digits, NULL) == value) {
            break;
        }
    }
    exponent = strchr(digits, 'e');
    e = atoi(exponent + 1);
    *exponent = 0;
    if (digits[0] == '-') {
        *at++ = '-';
    }
    for (k = 0, n = 0; digits[k]; k++) { /* the digits alone, whatever the locale puts between them */
        if (digits[k] >= '0' && digits[k] <= '9') {
            digits[n++] = digits[k];
        }
    }
    if (e < -4 || e >= 16) {
        at += sprintf(at, n > 1 ? "%c.%.*s" : "%c", digits[0], n - 1, digits + 1);
        sprintf(at, "e%c%02d", e < 0 ? '-' : '+', abs(e));
        return text;
    }
    for (k = e < 0 ? e : 0; k < n || k <= e + 1; k++) {
        if (k == e + 1) {
            *at++ = '.';
        }
        *at++ = k >= 0 && k < n ? digits[k] : '0';
    }
    *at = 0;
    return text;
}

/* Hands an error to the host; the text begins with the instance's name. */
static void say(const Host *host, const char *name, const char *text);

/* Says why something is refused; until a reset or a good state every step is refused from now on. */
static Status refuse(Instance *I, const char *format, ...) {
    char text[1024];
    va_list list;
    size_t n = (size_t)snprintf(text, sizeof text / 2, "%s: ", I->name);
    n = n < sizeof text / 2 ? n : sizeof text / 2 - 1;
    va_start(list, format);
    vsnprintf(text + n, sizeof text - n, format, list);
    va_end(list);
    I->failed = 1;
    say(&I->host, I->name, text);
    return STATUS_ERROR;
}

static Status refuse_unknown(Instance *I, Reference r) {
    return refuse(I, "there is no variable with value reference %u", r);
}

/* Says why a value is not taken. */
static Status refuse_value(Instance *I, Reference r, double value) {
    char a[NUMBER_SIZE], b[NUMBER_SIZE], c[NUMBER_SIZE], d[NUMBER_SIZE];
    if (r >= N_VARIABLES) {
        return r < TIME + (FMI_VERSION == 3) * (1 + N_INDICATORS)
                   ? refuse(I, "the variable with value reference %u is calculated and cannot be set", r)
                   : refuse_unknown(I, r);
    }
    if (model_kinds[r] == OUTPUT) {
        return refuse(I, "%s is an output and cannot be set", model_names[r]);
    }
    if (model_kinds[r] == PARAMETER && I->mode >= RUNNING) {
        return refuse(I, "parameter %s is fixed and cannot be set to %s after initialisation; reset first", model_names[r],
                      number(value, a));
    }
    return refuse(I, "%s = %s is refused: it must be a number from %s to %s; %s is kept", model_names[r], number(value, a),
                  number(model_lows[r], b), number(model_highs[r], c), number(I->values[r], d));
}

/* Says what went wrong in the equations. */
static Status refuse_fault(Instance *I, const char *what, int fault) {
    static const char *const words[] = {
        "", "float division by zero", "math domain error", "math range error", "list index out of range",
        "a number is no whole number within 2^53", "a negative number to a fractional power",
        "the components in the loop find no common start values"};
    char a[NUMBER_SIZE], b[NUMBER_SIZE], c[NUMBER_SIZE];
    if (fault < PY_REFUSED) {
        return refuse(I, "%s failed: %s", what, words[fault]);
    }
    fault -= PY_REFUSED;
    return refuse(I, "%s failed: %s = %s is refused: it must be a number from %s to %s", what, model_inner_names[fault],
                  number(I->model.refused, a), number(model_inner_lows[fault], b), number(model_inner_highs[fault], c));
}

#endif
