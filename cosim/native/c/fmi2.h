/* The functions of FMI 2.0. */

#ifndef FMI2_H
#define FMI2_H

#include "fmi2Functions.h"

#define ANSWER(c, call) ((c) ? (fmi2Status)(call) : fmi2Error)
#define INSTANCE(c) ((Instance *)(c))

static void say(const Host *host, const char *name, const char *text) {
    const fmi2CallbackLogger logger = (fmi2CallbackLogger)host->logger;
    char message[2048], *at = message;
    if (!logger) {
        return;
    }
    /* the host reads it as a format */
    for (; *text && at < message + sizeof message - 3; text++) {
        if (*text == '%') {
            *at++ = '%';
        }
        *at++ = *text;
    }
    *at = 0;
    logger(host->environment, name, fmi2Error, "logStatusError", message);
}

/* Life cycle */

const char *fmi2GetTypesPlatform(void) { return fmi2TypesPlatform; }

const char *fmi2GetVersion(void) { return fmi2Version; }

/* The folder that a file URI (or a plain path) names, in memory of its own; NULL if there is none. */
static char *folder_of(const char *uri) {
    char *folder, *at;
    const char *from = uri;
    if (!uri) {
        return NULL;
    }
    folder = at = (char *)malloc(strlen(uri) + 1);
    if (!folder) {
        return NULL;
    }
    if (!strncmp(from, "file:", 5)) {
        from += 5;
        if (!strncmp(from, "//", 2)) {
            from += 2;
            from += strcspn(from, "/"); /* the host's name */
        }
        if (from[0] == '/' && from[1] && from[2] == ':') {
            from++; /* a drive */
        }
    }
    while (*from) {
        char pair[3] = {0, 0, 0}, *end;
        if (from != uri && from[0] == '%' && from[1] && from[2]) {
            pair[0] = from[1];
            pair[1] = from[2];
            *at = (char)strtol(pair, &end, 16);
            if (end == pair + 2) {
                at++;
                from += 3;
                continue;
            }
        }
        *at++ = *from++;
    }
    *at = 0;
    return folder;
}

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources,
                              const fmi2CallbackFunctions *functions, fmi2Boolean visible, fmi2Boolean logging) {
    Host host = {NULL, NULL};
    (void)visible;
    (void)logging; /* there is nothing to log but errors, and those are always told */
    if (functions) {
        host.environment = functions->componentEnvironment;
        host.logger = (void (*)(void))functions->logger;
    }
    return new_instance(&host, name, guid, folder_of(resources), type != fmi2CoSimulation);
}

void fmi2FreeInstance(fmi2Component c) {
    if (c) {
        free_instance(INSTANCE(c));
    }
}

fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean on, size_t n, const fmi2String categories[]) {
    (void)on;
    (void)n;
    (void)categories;
    return c ? fmi2OK : fmi2Error;
}

fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean hasTolerance, fmi2Real tolerance, fmi2Real start,
                               fmi2Boolean hasStop, fmi2Real stop) {
    (void)hasTolerance;
    (void)tolerance;
    (void)hasStop;
    (void)stop;
    if (c && INSTANCE(c)->mode != INSTANTIATED) {
        return (fmi2Status)refuse(INSTANCE(c), "fmi2SetupExperiment after fmi2EnterInitializationMode; reset first");
    }
    return ANSWER(c, start_time(INSTANCE(c), start));
}

fmi2Status fmi2EnterInitializationMode(fmi2Component c) { return ANSWER(c, enter_initialisation(INSTANCE(c))); }

fmi2Status fmi2ExitInitializationMode(fmi2Component c) { return ANSWER(c, exit_initialisation(INSTANCE(c))); }

fmi2Status fmi2Terminate(fmi2Component c) { return ANSWER(c, end_run(INSTANCE(c))); }

fmi2Status fmi2Reset(fmi2Component c) { return ANSWER(c, reset(INSTANCE(c))); }

/* Values */

fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference r[], size_t n, const fmi2Real values[]) {
    return ANSWER(c, set_reals(INSTANCE(c), r, n, values));
}

fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference r[], size_t n, fmi2Real values[]) {
    return ANSWER(c, get_reals(INSTANCE(c), r, n, values));
}

fmi2Status fmi2SetInteger(fmi2Component c, const fmi2ValueReference r[], size_t n, const fmi2Integer values[]) {
    return ANSWER(c, set_wholes(INSTANCE(c), r, n, values));
}

fmi2Status fmi2GetInteger(fmi2Component c, const fmi2ValueReference r[], size_t n, fmi2Integer values[]) {
    return ANSWER(c, get_wholes(INSTANCE(c), r, n, values));
}

#define NONE_OF(kind) \
    fmi2Status fmi2Get##kind(fmi2Component c, const fmi2ValueReference r[], size_t n, fmi2##kind values[]) { \
        (void)r; \
        (void)values; \
        return ANSWER(c, none(INSTANCE(c), n, #kind)); \
    } \
    fmi2Status fmi2Set##kind(fmi2Component c, const fmi2ValueReference r[], size_t n, const fmi2##kind values[]) { \
        (void)r; \
        (void)values; \
        return ANSWER(c, none(INSTANCE(c), n, #kind)); \
    }

NONE_OF(Boolean)
NONE_OF(String)

/* Steps */

/* Derivatives hold for the next step only. */
fmi2Status fmi2SetRealInputDerivatives(fmi2Component c, const fmi2ValueReference r[], size_t n, const fmi2Integer order[],
                                       const fmi2Real values[]) {
    Instance *I = INSTANCE(c);
    Status status = I ? STATUS_OK : STATUS_ERROR;
    char text[NUMBER_SIZE];
    size_t k;
    for (k = 0; I && k < n; k++) {
        if (r[k] >= N_VARIABLES) {
            status = refuse_unknown(I, r[k]);
        } else if (model_kinds[r[k]] != INPUT) {
            status = refuse(I, "%s is no input, so its derivative cannot be set", model_names[r[k]]);
        } else if (order[k] < 1 || order[k] > ORDERS) {
            status = refuse(I, "derivative %d of %s is refused: orders from 1 to %d are used", (int)order[k], model_names[r[k]],
                            ORDERS);
        } else if (!isfinite(values[k])) {
            status = refuse(I, "derivative %d of %s = %s is refused: it must be a number", (int)order[k], model_names[r[k]],
                            number(values[k], text));
        } else {
            I->derivatives[r[k]][order[k] - 1] = values[k];
            I->slopes = 1;
        }
    }
    return (fmi2Status)status;
}

fmi2Status fmi2GetRealOutputDerivatives(fmi2Component c, const fmi2ValueReference r[], size_t n, const fmi2Integer order[],
                                        fmi2Real values[]) {
    (void)r;
    (void)order;
    (void)values;
    return ANSWER(c, n ? refuse(INSTANCE(c), "derivatives of outputs are not provided") : STATUS_OK);
}

fmi2Status fmi2DoStep(fmi2Component c, fmi2Real time, fmi2Real step, fmi2Boolean noSetFMUStatePriorToCurrentPoint) {
    (void)noSetFMUStatePriorToCurrentPoint;
    return ANSWER(c, make_step(INSTANCE(c), time, step));
}

fmi2Status fmi2CancelStep(fmi2Component c) {
    return ANSWER(c, refuse(INSTANCE(c), "fmi2CancelStep: no step runs in the background"));
}

fmi2Status fmi2GetStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Status *value) {
    (void)kind;
    if (!c) {
        return fmi2Error;
    }
    *value = INSTANCE(c)->failed ? fmi2Error : fmi2OK; /* no step is ever pending */
    return fmi2OK;
}

fmi2Status fmi2GetRealStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Real *value) {
    if (!c || kind != fmi2LastSuccessfulTime) {
        return fmi2Discard;
    }
    *value = INSTANCE(c)->time;
    return fmi2OK;
}

fmi2Status fmi2GetIntegerStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Integer *value) {
    (void)c;
    (void)kind;
    (void)value;
    return fmi2Discard;
}

fmi2Status fmi2GetBooleanStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Boolean *value) {
    if (!c || kind != fmi2Terminated) {
        return fmi2Discard;
    }
    *value = fmi2False; /* it never ends by itself */
    return fmi2OK;
}

fmi2Status fmi2GetStringStatus(fmi2Component c, const fmi2StatusKind kind, fmi2String *value) {
    (void)c;
    (void)kind;
    (void)value;
    return fmi2Discard;
}

/* The whole state */

fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate *state) { return ANSWER(c, take_state(INSTANCE(c), state)); }

fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate state) { return ANSWER(c, put_state(INSTANCE(c), state)); }

fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate *state) {
    (void)c;
    free_state(state);
    return fmi2OK;
}

fmi2Status fmi2SerializedFMUstateSize(fmi2Component c, fmi2FMUstate state, size_t *size) {
    (void)state;
    *size = sizeof(Saved);
    return c ? fmi2OK : fmi2Error;
}

fmi2Status fmi2SerializeFMUstate(fmi2Component c, fmi2FMUstate state, fmi2Byte bytes[], size_t size) {
    return ANSWER(c, state_to_bytes(INSTANCE(c), state, bytes, size));
}

fmi2Status fmi2DeSerializeFMUstate(fmi2Component c, const fmi2Byte bytes[], size_t size, fmi2FMUstate *state) {
    return ANSWER(c, state_from_bytes(INSTANCE(c), bytes, size, state));
}

/* Model exchange */

fmi2Status fmi2EnterEventMode(fmi2Component c) { return ANSWER(c, in_exchange(INSTANCE(c), "EnterEventMode", 0)); }

fmi2Status fmi2EnterContinuousTimeMode(fmi2Component c) {
    return ANSWER(c, in_exchange(INSTANCE(c), "EnterContinuousTimeMode", 0));
}

fmi2Status fmi2NewDiscreteStates(fmi2Component c, fmi2EventInfo *info) {
    int jumped = 0;
    const fmi2Status status = ANSWER(c, make_event(INSTANCE(c), "NewDiscreteStates", &jumped));
    memset(info, 0, sizeof *info); /* nothing to iterate, no end */
    info->nextEventTimeDefined = SAMPLED && status == fmi2OK ? fmi2True : fmi2False;
    info->nextEventTime = info->nextEventTimeDefined ? next_sample(INSTANCE(c)) : 0.0;
    info->valuesOfContinuousStatesChanged = jumped ? fmi2True : fmi2False;
    return status;
}

fmi2Status fmi2CompletedIntegratorStep(fmi2Component c, fmi2Boolean noSetFMUStatePriorToCurrentPoint,
                                       fmi2Boolean *enterEventMode, fmi2Boolean *terminateSimulation) {
    (void)noSetFMUStatePriorToCurrentPoint;
    *enterEventMode = *terminateSimulation = fmi2False;
    return ANSWER(c, in_exchange(INSTANCE(c), "CompletedIntegratorStep", 0));
}

fmi2Status fmi2SetTime(fmi2Component c, fmi2Real time) { return ANSWER(c, set_time(INSTANCE(c), time)); }

fmi2Status fmi2SetContinuousStates(fmi2Component c, const fmi2Real x[], size_t n) {
    return ANSWER(c, set_states(INSTANCE(c), x, n));
}

fmi2Status fmi2GetContinuousStates(fmi2Component c, fmi2Real x[], size_t n) {
    return ANSWER(c, get_states(INSTANCE(c), x, n));
}

fmi2Status fmi2GetDerivatives(fmi2Component c, fmi2Real rates[], size_t n) {
    return ANSWER(c, get_rates(INSTANCE(c), "GetDerivatives", rates, n));
}

fmi2Status fmi2GetDirectionalDerivative(fmi2Component c, const fmi2ValueReference unknowns[], size_t n_unknowns,
                                        const fmi2ValueReference knowns[], size_t n_knowns, const fmi2Real seed[],
                                        fmi2Real sensitivity[]) {
    return ANSWER(c, directional(INSTANCE(c), unknowns, n_unknowns, knowns, n_knowns, seed, sensitivity));
}

fmi2Status fmi2GetEventIndicators(fmi2Component c, fmi2Real indicators[], size_t n) {
    return ANSWER(c, get_indicators(INSTANCE(c), indicators, n));
}

fmi2Status fmi2GetNominalsOfContinuousStates(fmi2Component c, fmi2Real nominals[], size_t n) {
    return ANSWER(c, get_nominals(INSTANCE(c), nominals, n));
}

#endif
