/* The functions of FMI 3.0: co-simulation, and model exchange where the block has it. Those for what is not there (arrays,
   clocks, configuration, scheduled execution) are all exported, and refuse in words. */

#ifndef FMI3_H
#define FMI3_H

#include "fmi3Functions.h"

#define ANSWER(c, call) ((c) ? (fmi3Status)(call) : fmi3Error)
#define INSTANCE(c) ((Instance *)(c))

static void say(const Host *host, const char *name, const char *text) {
    const fmi3LogMessageCallback logger = (fmi3LogMessageCallback)host->logger;
    (void)name; /* the text begins with it */
    if (logger) {
        logger(host->environment, fmi3Error, "logStatusError", text);
    }
}

/* Life cycle */

const char *fmi3GetVersion(void) { return fmi3Version; }

/* The path of a folder, in memory of its own; NULL if there is none. */
static char *copied_path(const char *path) {
    char *copy = path ? (char *)malloc(strlen(path) + 1) : NULL;
    return copy ? strcpy(copy, path) : NULL;
}

static Instance *made(fmi3String name, fmi3String token, fmi3String resources, void *environment, fmi3LogMessageCallback logger,
                      int exchange) {
    Host host = {NULL, NULL};
    host.environment = environment;
    host.logger = (void (*)(void))logger;
    return new_instance(&host, name, token, copied_path(resources), exchange);
}

fmi3Instance fmi3InstantiateModelExchange(fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible,
                                          fmi3Boolean logging, fmi3InstanceEnvironment environment,
                                          fmi3LogMessageCallback logger) {
    (void)visible;
    (void)logging; /* there is nothing to log but errors, and those are always told */
    return made(name, token, resources, environment, logger, 1);
}

fmi3Instance fmi3InstantiateCoSimulation(fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible,
                                         fmi3Boolean logging, fmi3Boolean eventModeUsed, fmi3Boolean earlyReturnAllowed,
                                         const fmi3ValueReference required[], size_t n_required,
                                         fmi3InstanceEnvironment environment, fmi3LogMessageCallback logger,
                                         fmi3IntermediateUpdateCallback update) {
    Instance *I = made(name, token, resources, environment, logger, 0);
    (void)visible;
    (void)logging;
    (void)earlyReturnAllowed; /* a step never returns early */
    (void)required;
    (void)update;
    if (I && (eventModeUsed || n_required)) {
        refuse(I, eventModeUsed ? "%s has no event mode" : "%s has no intermediate update", MODEL_NAME);
        free_instance(I);
        return NULL;
    }
    return I;
}

fmi3Instance fmi3InstantiateScheduledExecution(fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible,
                                               fmi3Boolean logging, fmi3InstanceEnvironment environment,
                                               fmi3LogMessageCallback logger, fmi3ClockUpdateCallback update,
                                               fmi3LockPreemptionCallback lock, fmi3UnlockPreemptionCallback unlock) {
    Instance *I = made(name, token, resources, environment, logger, 0);
    (void)visible;
    (void)logging;
    (void)update;
    (void)lock;
    (void)unlock;
    if (I) {
        refuse(I, "%s is not for scheduled execution", MODEL_NAME);
        free_instance(I);
    }
    return NULL;
}

void fmi3FreeInstance(fmi3Instance c) {
    if (c) {
        free_instance(INSTANCE(c));
    }
}

fmi3Status fmi3SetDebugLogging(fmi3Instance c, fmi3Boolean on, size_t n, const fmi3String categories[]) {
    (void)on;
    (void)n;
    (void)categories;
    return c ? fmi3OK : fmi3Error;
}

fmi3Status fmi3EnterInitializationMode(fmi3Instance c, fmi3Boolean hasTolerance, fmi3Float64 tolerance, fmi3Float64 start,
                                       fmi3Boolean hasStop, fmi3Float64 stop) {
    (void)hasTolerance;
    (void)tolerance;
    (void)hasStop;
    (void)stop;
    if (c && INSTANCE(c)->mode == INSTANTIATED && start_time(INSTANCE(c), start) != STATUS_OK) {
        return fmi3Error;
    }
    return ANSWER(c, enter_initialisation(INSTANCE(c)));
}

fmi3Status fmi3ExitInitializationMode(fmi3Instance c) { return ANSWER(c, exit_initialisation(INSTANCE(c))); }

fmi3Status fmi3Terminate(fmi3Instance c) { return ANSWER(c, end_run(INSTANCE(c))); }

fmi3Status fmi3Reset(fmi3Instance c) { return ANSWER(c, reset(INSTANCE(c))); }

fmi3Status fmi3EnterConfigurationMode(fmi3Instance c) {
    return ANSWER(c, refuse(INSTANCE(c), "fmi3EnterConfigurationMode: there is no structural parameter"));
}

fmi3Status fmi3ExitConfigurationMode(fmi3Instance c) {
    return ANSWER(c, refuse(INSTANCE(c), "fmi3ExitConfigurationMode: there is no structural parameter"));
}

/* Values */

/* Every variable is one number. */
static Status scalars(Instance *I, size_t n, size_t n_values) {
    return n == n_values ? STATUS_OK
                         : refuse(I, "%lu variables and %lu values: every variable has one", (unsigned long)n,
                                  (unsigned long)n_values);
}

fmi3Status fmi3SetFloat64(fmi3Instance c, const fmi3ValueReference r[], size_t n, const fmi3Float64 values[], size_t n_values) {
    return c && !scalars(INSTANCE(c), n, n_values) ? (fmi3Status)set_reals(INSTANCE(c), r, n, values) : fmi3Error;
}

fmi3Status fmi3GetFloat64(fmi3Instance c, const fmi3ValueReference r[], size_t n, fmi3Float64 values[], size_t n_values) {
    return c && !scalars(INSTANCE(c), n, n_values) ? (fmi3Status)get_reals(INSTANCE(c), r, n, values) : fmi3Error;
}

fmi3Status fmi3SetInt32(fmi3Instance c, const fmi3ValueReference r[], size_t n, const fmi3Int32 values[], size_t n_values) {
    return c && !scalars(INSTANCE(c), n, n_values) ? (fmi3Status)set_wholes(INSTANCE(c), r, n, values) : fmi3Error;
}

fmi3Status fmi3GetInt32(fmi3Instance c, const fmi3ValueReference r[], size_t n, fmi3Int32 values[], size_t n_values) {
    return c && !scalars(INSTANCE(c), n, n_values) ? (fmi3Status)get_wholes(INSTANCE(c), r, n, values) : fmi3Error;
}

#define NONE_OF(kind) \
    fmi3Status fmi3Get##kind(fmi3Instance c, const fmi3ValueReference r[], size_t n, fmi3##kind values[], size_t n_values) { \
        (void)r; \
        (void)values; \
        (void)n_values; \
        return ANSWER(c, none(INSTANCE(c), n, #kind)); \
    } \
    fmi3Status fmi3Set##kind(fmi3Instance c, const fmi3ValueReference r[], size_t n, const fmi3##kind values[], \
                             size_t n_values) { \
        (void)r; \
        (void)values; \
        (void)n_values; \
        return ANSWER(c, none(INSTANCE(c), n, #kind)); \
    }

NONE_OF(Float32)
NONE_OF(Int8)
NONE_OF(UInt8)
NONE_OF(Int16)
NONE_OF(UInt16)
NONE_OF(UInt32)
NONE_OF(Int64)
NONE_OF(UInt64)
NONE_OF(Boolean)
NONE_OF(String)

fmi3Status fmi3GetBinary(fmi3Instance c, const fmi3ValueReference r[], size_t n, size_t sizes[], fmi3Binary values[],
                         size_t n_values) {
    (void)r;
    (void)sizes;
    (void)values;
    (void)n_values;
    return ANSWER(c, none(INSTANCE(c), n, "Binary"));
}

fmi3Status fmi3SetBinary(fmi3Instance c, const fmi3ValueReference r[], size_t n, const size_t sizes[],
                         const fmi3Binary values[], size_t n_values) {
    (void)r;
    (void)sizes;
    (void)values;
    (void)n_values;
    return ANSWER(c, none(INSTANCE(c), n, "Binary"));
}

/* Clocks: there are none */

fmi3Status fmi3GetClock(fmi3Instance c, const fmi3ValueReference r[], size_t n, fmi3Clock values[]) {
    (void)r;
    (void)values;
    return ANSWER(c, none(INSTANCE(c), n, "Clock"));
}

fmi3Status fmi3SetClock(fmi3Instance c, const fmi3ValueReference r[], size_t n, const fmi3Clock values[]) {
    (void)r;
    (void)values;
    return ANSWER(c, none(INSTANCE(c), n, "Clock"));
}

fmi3Status fmi3GetIntervalDecimal(fmi3Instance c, const fmi3ValueReference r[], size_t n, fmi3Float64 intervals[],
                                  fmi3IntervalQualifier qualifiers[]) {
    (void)r;
    (void)intervals;
    (void)qualifiers;
    return ANSWER(c, none(INSTANCE(c), n, "Clock"));
}

fmi3Status fmi3GetIntervalFraction(fmi3Instance c, const fmi3ValueReference r[], size_t n, fmi3UInt64 counters[],
                                   fmi3UInt64 resolutions[], fmi3IntervalQualifier qualifiers[]) {
    (void)r;
    (void)counters;
    (void)resolutions;
    (void)qualifiers;
    return ANSWER(c, none(INSTANCE(c), n, "Clock"));
}

fmi3Status fmi3GetShiftDecimal(fmi3Instance c, const fmi3ValueReference r[], size_t n, fmi3Float64 shifts[]) {
    (void)r;
    (void)shifts;
    return ANSWER(c, none(INSTANCE(c), n, "Clock"));
}

fmi3Status fmi3GetShiftFraction(fmi3Instance c, const fmi3ValueReference r[], size_t n, fmi3UInt64 counters[],
                                fmi3UInt64 resolutions[]) {
    (void)r;
    (void)counters;
    (void)resolutions;
    return ANSWER(c, none(INSTANCE(c), n, "Clock"));
}

fmi3Status fmi3SetIntervalDecimal(fmi3Instance c, const fmi3ValueReference r[], size_t n, const fmi3Float64 intervals[]) {
    (void)r;
    (void)intervals;
    return ANSWER(c, none(INSTANCE(c), n, "Clock"));
}

fmi3Status fmi3SetIntervalFraction(fmi3Instance c, const fmi3ValueReference r[], size_t n, const fmi3UInt64 counters[],
                                   const fmi3UInt64 resolutions[]) {
    (void)r;
    (void)counters;
    (void)resolutions;
    return ANSWER(c, none(INSTANCE(c), n, "Clock"));
}

fmi3Status fmi3SetShiftDecimal(fmi3Instance c, const fmi3ValueReference r[], size_t n, const fmi3Float64 shifts[]) {
    (void)r;
    (void)shifts;
    return ANSWER(c, none(INSTANCE(c), n, "Clock"));
}

fmi3Status fmi3SetShiftFraction(fmi3Instance c, const fmi3ValueReference r[], size_t n, const fmi3UInt64 counters[],
                                const fmi3UInt64 resolutions[]) {
    (void)r;
    (void)counters;
    (void)resolutions;
    return ANSWER(c, none(INSTANCE(c), n, "Clock"));
}

fmi3Status fmi3ActivateModelPartition(fmi3Instance c, fmi3ValueReference clock, fmi3Float64 time) {
    (void)clock;
    (void)time;
    return ANSWER(c, none(INSTANCE(c), 1, "Clock"));
}

/* What depends on what: variables, in the model description; their elements are the variables */

fmi3Status fmi3GetNumberOfVariableDependencies(fmi3Instance c, fmi3ValueReference r, size_t *count) {
    (void)r;
    *count = 0;
    return ANSWER(c, refuse(INSTANCE(c), "dependencies of elements are not provided: ModelStructure lists all there are"));
}

fmi3Status fmi3GetVariableDependencies(fmi3Instance c, fmi3ValueReference dependent, size_t elements[],
                                       fmi3ValueReference independents[], size_t of_independents[],
                                       fmi3DependencyKind kinds[], size_t count) {
    (void)dependent;
    (void)elements;
    (void)independents;
    (void)of_independents;
    (void)kinds;
    (void)count;
    return ANSWER(c, refuse(INSTANCE(c), "dependencies of elements are not provided: ModelStructure lists all there are"));
}

/* Steps */

fmi3Status fmi3EnterStepMode(fmi3Instance c) {
    return ANSWER(c, refuse(INSTANCE(c), "fmi3EnterStepMode: there is no event mode in co-simulation"));
}

fmi3Status fmi3DoStep(fmi3Instance c, fmi3Float64 time, fmi3Float64 step, fmi3Boolean noSetFMUStatePriorToCurrentPoint,
                      fmi3Boolean *eventHandlingNeeded, fmi3Boolean *terminateSimulation, fmi3Boolean *earlyReturn,
                      fmi3Float64 *lastSuccessfulTime) {
    Status status;
    (void)noSetFMUStatePriorToCurrentPoint;
    if (!c) {
        return fmi3Error;
    }
    *eventHandlingNeeded = *terminateSimulation = *earlyReturn = fmi3False;
    status = make_step(INSTANCE(c), time, step);
    *lastSuccessfulTime = INSTANCE(c)->time;
    return (fmi3Status)status;
}

fmi3Status fmi3GetOutputDerivatives(fmi3Instance c, const fmi3ValueReference r[], size_t n, const fmi3Int32 orders[],
                                    fmi3Float64 values[], size_t n_values) {
    (void)r;
    (void)orders;
    (void)values;
    (void)n_values;
    return ANSWER(c, n ? refuse(INSTANCE(c), "derivatives of outputs are not provided") : STATUS_OK);
}

/* The whole state */

fmi3Status fmi3GetFMUState(fmi3Instance c, fmi3FMUState *state) { return ANSWER(c, take_state(INSTANCE(c), state)); }

fmi3Status fmi3SetFMUState(fmi3Instance c, fmi3FMUState state) { return ANSWER(c, put_state(INSTANCE(c), state)); }

fmi3Status fmi3FreeFMUState(fmi3Instance c, fmi3FMUState *state) {
    (void)c;
    free_state(state);
    return fmi3OK;
}

fmi3Status fmi3SerializedFMUStateSize(fmi3Instance c, fmi3FMUState state, size_t *size) {
    (void)state;
    *size = sizeof(Saved);
    return c ? fmi3OK : fmi3Error;
}

fmi3Status fmi3SerializeFMUState(fmi3Instance c, fmi3FMUState state, fmi3Byte bytes[], size_t size) {
    return ANSWER(c, state_to_bytes(INSTANCE(c), state, bytes, size));
}

fmi3Status fmi3DeserializeFMUState(fmi3Instance c, const fmi3Byte bytes[], size_t size, fmi3FMUState *state) {
    return ANSWER(c, state_from_bytes(INSTANCE(c), bytes, size, state));
}

/* Model exchange */

fmi3Status fmi3EnterEventMode(fmi3Instance c) { return ANSWER(c, in_exchange(INSTANCE(c), "EnterEventMode", 0)); }

fmi3Status fmi3EnterContinuousTimeMode(fmi3Instance c) {
    return ANSWER(c, in_exchange(INSTANCE(c), "EnterContinuousTimeMode", 0));
}

fmi3Status fmi3EvaluateDiscreteStates(fmi3Instance c) {
    return ANSWER(c, refuse(INSTANCE(c), "fmi3EvaluateDiscreteStates: there is no discrete state"));
}

fmi3Status fmi3UpdateDiscreteStates(fmi3Instance c, fmi3Boolean *needUpdate, fmi3Boolean *terminate, fmi3Boolean *nominals,
                                    fmi3Boolean *states, fmi3Boolean *hasNextEvent, fmi3Float64 *nextEvent) {
    int jumped = 0;
    const fmi3Status status = ANSWER(c, make_event(INSTANCE(c), "UpdateDiscreteStates", &jumped));
    *needUpdate = *terminate = *nominals = fmi3False;
    *hasNextEvent = SAMPLED && status == fmi3OK;
    *nextEvent = *hasNextEvent ? next_sample(INSTANCE(c)) : 0.0;
    *states = jumped != 0;
    return status;
}

fmi3Status fmi3CompletedIntegratorStep(fmi3Instance c, fmi3Boolean noSetFMUStatePriorToCurrentPoint,
                                       fmi3Boolean *enterEventMode, fmi3Boolean *terminateSimulation) {
    (void)noSetFMUStatePriorToCurrentPoint;
    *enterEventMode = *terminateSimulation = fmi3False;
    return ANSWER(c, in_exchange(INSTANCE(c), "CompletedIntegratorStep", 0));
}

fmi3Status fmi3SetTime(fmi3Instance c, fmi3Float64 time) { return ANSWER(c, set_time(INSTANCE(c), time)); }

fmi3Status fmi3SetContinuousStates(fmi3Instance c, const fmi3Float64 x[], size_t n) {
    return ANSWER(c, set_states(INSTANCE(c), x, n));
}

fmi3Status fmi3GetContinuousStates(fmi3Instance c, fmi3Float64 x[], size_t n) {
    return ANSWER(c, get_states(INSTANCE(c), x, n));
}

fmi3Status fmi3GetContinuousStateDerivatives(fmi3Instance c, fmi3Float64 rates[], size_t n) {
    return ANSWER(c, get_rates(INSTANCE(c), "GetContinuousStateDerivatives", rates, n));
}

fmi3Status fmi3GetNominalsOfContinuousStates(fmi3Instance c, fmi3Float64 nominals[], size_t n) {
    return ANSWER(c, get_nominals(INSTANCE(c), nominals, n));
}

fmi3Status fmi3GetEventIndicators(fmi3Instance c, fmi3Float64 indicators[], size_t n) {
    return ANSWER(c, get_indicators(INSTANCE(c), indicators, n));
}

fmi3Status fmi3GetNumberOfEventIndicators(fmi3Instance c, size_t *n) {
    *n = N_INDICATORS;
    return c ? fmi3OK : fmi3Error;
}

fmi3Status fmi3GetNumberOfContinuousStates(fmi3Instance c, size_t *n) {
    *n = N_STATES;
    return c ? fmi3OK : fmi3Error;
}

/* As many seeds as knowns and sensitivities as unknowns, or the other way round for the adjoint. */
fmi3Status fmi3GetDirectionalDerivative(fmi3Instance c, const fmi3ValueReference unknowns[], size_t n_unknowns,
                                        const fmi3ValueReference knowns[], size_t n_knowns, const fmi3Float64 seed[],
                                        size_t n_seed, fmi3Float64 sensitivity[], size_t n_sensitivity) {
    if (!c || scalars(INSTANCE(c), n_knowns, n_seed) || scalars(INSTANCE(c), n_unknowns, n_sensitivity)) {
        return fmi3Error;
    }
    return (fmi3Status)directional(INSTANCE(c), unknowns, n_unknowns, knowns, n_knowns, seed, sensitivity);
}

fmi3Status fmi3GetAdjointDerivative(fmi3Instance c, const fmi3ValueReference unknowns[], size_t n_unknowns,
                                    const fmi3ValueReference knowns[], size_t n_knowns, const fmi3Float64 seed[],
                                    size_t n_seed, fmi3Float64 sensitivity[], size_t n_sensitivity) {
    if (!c || scalars(INSTANCE(c), n_unknowns, n_seed) || scalars(INSTANCE(c), n_knowns, n_sensitivity)) {
        return fmi3Error;
    }
    return (fmi3Status)adjoint(INSTANCE(c), unknowns, n_unknowns, knowns, n_knowns, seed, sensitivity);
}

#endif
