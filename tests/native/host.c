/* A host that is not Python, linked with an FMU's sources under the sanitizers: right use, bad use, many instances.

   host RESOURCES GUID: prints "done"; an error of memory or an undefined operation ends it. */

#include "fmu.c"

#include <stdarg.h>

static int told;

static void logger(fmi2ComponentEnvironment environment, fmi2String name, fmi2Status status, fmi2String category,
                   fmi2String message, ...) {
    va_list rest;
    (void)environment;
    (void)name;
    (void)status;
    (void)category;
    va_start(rest, message);
    vfprintf(stderr, message, rest);
    va_end(rest);
    fputc('\n', stderr);
    told++;
}

static const fmi2CallbackFunctions host = {logger, calloc, free, NULL, NULL};

/* A number from 0 to 1 of a small generator. */
static double chance(unsigned *seed) { return (*seed = *seed * 1664525u + 1013904223u) / 4294967296.0; }

/* Parameters anywhere within their bounds, some of them. */
static void disturb(fmi2Component c, unsigned *seed) {
    fmi2ValueReference r;
    for (r = 0; r < N_VARIABLES; r++) {
        double span = model_highs[r] - model_lows[r], value = model_lows[r] + chance(seed) * span;
        fmi2Integer whole;
        if (model_kinds[r] != PARAMETER || chance(seed) < 0.6) {
            continue;
        }
        if (model_integers[r]) {
            whole = (fmi2Integer)value;
            fmi2SetInteger(c, &r, 1, &whole);
        } else {
            value = chance(seed) < 0.7 ? model_starts[r] * (0.5 + chance(seed)) : value;
            fmi2SetReal(c, &r, 1, &value);
        }
    }
}

static fmi2Status drive(fmi2Component c, int first, int steps, unsigned *seed) {
    fmi2Status worst = fmi2OK;
    int k;
    for (k = first; k < first + steps; k++) {
        double h = chance(seed) < 0.1 ? 0.02 : 1e-3, value, slope;
        const fmi2Integer order = 1 + k % 3;
        fmi2ValueReference r;
        for (r = 0; (int)r < N_INPUTS; r++) {
            value = (chance(seed) - 0.5) * (model_highs[r] > 1e6 ? 1e6 : model_highs[r]);
            slope = chance(seed) * value;
            worst |= fmi2SetReal(c, &r, 1, &value);
            worst |= fmi2SetRealInputDerivatives(c, &r, 1, &order, &slope);
        }
        worst |= fmi2DoStep(c, k * 1e-3, h, fmi2True);
    }
    return worst;
}

/* Everything that a host should not do; each must be refused and none must do harm. */
static void misuse(fmi2Component c) {
    const fmi2ValueReference references[] = {0, N_VARIABLES, 4000000000u};
    const double values[] = {NAN, INFINITY, -1e300};
    const fmi2Integer orders[] = {0, 4, -2147483647};
    fmi2Boolean truth = 0;
    fmi2Integer wholes[3] = {2147483647, -2147483647, 0};
    fmi2String text = "x";
    fmi2FMUstate state = NULL;
    fmi2Byte bytes[sizeof(Saved)];
    double read[3];
    size_t k;
    fmi2SetReal(c, references, 3, values);
    fmi2GetReal(c, references, 3, read);
    fmi2SetInteger(c, references, 3, wholes);
    fmi2GetInteger(c, references, 3, wholes);
    fmi2SetBoolean(c, references, 1, &truth);
    fmi2GetString(c, references, 1, &text);
    fmi2SetRealInputDerivatives(c, references, 3, orders, values);
    fmi2GetRealOutputDerivatives(c, references, 1, orders, read);
    for (k = 0; k < 3; k++) {
        fmi2DoStep(c, values[k], values[k], fmi2True);
        fmi2SetupExperiment(c, fmi2False, 0.0, values[k], fmi2False, 0.0);
    }
    fmi2DoStep(c, 0.0, -1e-3, fmi2True);
    fmi2EnterInitializationMode(c);
    fmi2ExitInitializationMode(c);
    fmi2SetFMUstate(c, NULL);
    memset(bytes, 255, sizeof bytes);
    if (fmi2DeSerializeFMUstate(c, bytes, sizeof bytes, &state) == fmi2OK) {
        fmi2SetFMUstate(c, state);
    }
    fmi2DeSerializeFMUstate(c, bytes, 3, &state);
    fmi2FreeFMUstate(c, &state);
    fmi2CancelStep(c);
}

/* Model exchange: an explicit Euler integration with the events that were told, then every call misused. */
static int exchange(char **words, unsigned *seed) {
    fmi2Component c = fmi2Instantiate("a", fmi2ModelExchange, words[2], words[1], &host, 0, 0);
    fmi2EventInfo info;
    fmi2Boolean one, other;
    double x[N_STATES + 1], rates[N_STATES + 1], left[N_INDICATORS + 1], read[2], u;
    const fmi2ValueReference input = 0, locals[] = {N_VARIABLES, N_VARIABLES + 2 * N_STATES - 1};
    int k, j, status = fmi2SetupExperiment(c, fmi2False, 0.0, 0.0, fmi2False, 0.0) | fmi2EnterInitializationMode(c);
    status |= fmi2ExitInitializationMode(c) | fmi2NewDiscreteStates(c, &info) | fmi2EnterContinuousTimeMode(c);
    status |= fmi2GetContinuousStates(c, x, N_STATES);
    for (k = 0; k < 1000; k++) {
        u = (chance(seed) - 0.5) * 1e-3;
        status |= fmi2SetTime(c, k * 1e-4) | fmi2SetContinuousStates(c, x, N_STATES);
        status |= N_INPUTS ? fmi2SetReal(c, &input, 1, &u) : fmi2OK;
        if (info.nextEventTimeDefined && k * 1e-4 >= info.nextEventTime) {
            status |= fmi2EnterEventMode(c) | fmi2NewDiscreteStates(c, &info) | fmi2EnterContinuousTimeMode(c);
        }
        status |= fmi2GetDerivatives(c, rates, N_STATES) | fmi2GetEventIndicators(c, left, N_INDICATORS);
        status |= fmi2CompletedIntegratorStep(c, fmi2True, &one, &other);
        status |= N_STATES ? fmi2GetReal(c, locals, 2, read) : fmi2OK;
        for (j = 0; j < N_STATES; j++) {
            x[j] += 1e-4 * rates[j];
        }
    }
    fmi2SetTime(c, 9e8); /* so far that its samples would never end */
    fmi2NewDiscreteStates(c, &info);
    x[0] = NAN;
    fmi2SetContinuousStates(c, x, N_STATES);
    fmi2SetContinuousStates(c, x, N_STATES + 3);
    fmi2GetDerivatives(c, rates, N_STATES + 3);
    misuse(c);
    fmi2GetDerivatives(c, rates, N_STATES);
    fmi2GetDerivatives(NULL, rates, N_STATES);
    fmi2FreeInstance(c);
    return status;
}

int main(int count, char **words) {
    fmi2Component slaves[20];
    fmi2FMUstate state = NULL;
    fmi2Byte bytes[sizeof(Saved)];
    unsigned seed = 1;
    int k, run, quiet;
    size_t size;
    if (count != 3 || fmi2Instantiate("a", fmi2CoSimulation, "{wrong}", words[1], &host, 0, 0)) {
        return 2;
    }
    if (exchange(words, &seed)) {
        return 7;
    }
    for (k = 0; k < 20; k++) {
        slaves[k] = fmi2Instantiate("a", fmi2CoSimulation, words[2], words[1], &host, 0, 0);
    }
    quiet = told;
    for (run = 0; run < 3; run++) { /* nominal: nothing to refuse */
        fmi2SetupExperiment(slaves[0], fmi2False, 0.0, 0.0, fmi2False, 0.0);
        if (fmi2EnterInitializationMode(slaves[0]) | fmi2ExitInitializationMode(slaves[0])) {
            return 3;
        }
        for (k = 0; k < 200; k++) {
            if (fmi2DoStep(slaves[0], k * 1e-3, 1e-3, fmi2True)) {
                return 4;
            }
        }
        fmi2Terminate(slaves[0]);
        fmi2Reset(slaves[0]);
    }
    if (told != quiet) {
        return 5;
    }
    for (run = 0; run < 40; run++) { /* any parameters, then a state saved, damaged use, and the state restored */
        fmi2Component c = slaves[run % 20];
        fmi2Reset(c);
        disturb(c, &seed);
        fmi2SetupExperiment(c, fmi2False, 0.0, run, fmi2False, 0.0);
        fmi2EnterInitializationMode(c);
        fmi2ExitInitializationMode(c);
        drive(c, 0, 60, &seed);
        fmi2GetFMUstate(c, &state);
        fmi2SerializedFMUstateSize(c, state, &size);
        if (size != sizeof bytes || fmi2SerializeFMUstate(c, state, bytes, size)) {
            return 6;
        }
        misuse(c);
        fmi2SetFMUstate(c, state);
        drive(c, 60, 20, &seed);
        fmi2DeSerializeFMUstate(slaves[(run + 1) % 20], bytes, size, &state);
        fmi2SetFMUstate(slaves[(run + 1) % 20], state);
        drive(slaves[(run + 1) % 20], 60, 20, &seed);
    }
    fmi2FreeFMUstate(slaves[0], &state);
    for (k = 0; k < 20; k++) {
        misuse(slaves[k]);
        fmi2FreeInstance(slaves[k]);
    }
    misuse(NULL);
    fmi2FreeInstance(NULL);
    puts("done");
    return 0;
}
