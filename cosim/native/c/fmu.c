/* FMI 2.0 around the model in model.h. No global state, and no allocation from the end of initialisation on.

   Bad use is refused with fmi2Error and a message that names the variable, its value and the limit; from then on steps are
   refused until fmi2Reset or a good state. Compile it alone, with this folder as include path and without contraction of
   floating-point operations:

       cc -std=c99 -O2 -ffp-contract=off -fPIC -shared -fvisibility=hidden fmu.c -lm -o NAME.so

   Define FMI2_FUNCTION_PREFIX to link several of them into one program. */

#include "fmi2Functions.h"

#include "semantics.h"

#include "model.h"

#include "instance.h"

#include "tables.h"

#include "saved.h"

#if EXCHANGE
#include "exchange.h"
#endif

/* Life cycle */

const char *fmi2GetTypesPlatform(void) { return fmi2TypesPlatform; }

const char *fmi2GetVersion(void) { return fmi2Version; }

static void start_values(Instance *I) {
    I->mode = INSTANTIATED;
    I->failed = I->begun = I->slopes = 0;
    I->time = 0.0;
    I->step = 1e-3;
    memcpy(I->values, model_starts, sizeof I->values);
    memset(I->derivatives, 0, sizeof I->derivatives);
}

fmi2Component fmi2Instantiate(fmi2String name, fmi2Type type, fmi2String guid, fmi2String resources,
                              const fmi2CallbackFunctions *functions, fmi2Boolean visible, fmi2Boolean logging) {
    Instance *I;
    const char *shown = name ? name : "?";
    char text[512];
    (void)visible;
    (void)logging; /* there is nothing to log but errors, and those are always told */
    if (!guid || strcmp(guid, MODEL_GUID) != 0) {
        snprintf(text, sizeof text, "%.100s: the GUID %.100s is refused: this is %s %s", shown, guid ? guid : "(none)",
                 MODEL_NAME, MODEL_GUID);
        say(functions, shown, fmi2Error, text);
        return NULL;
    }
    if (type != fmi2CoSimulation && !(EXCHANGE && type == fmi2ModelExchange)) {
        snprintf(text, sizeof text, "%.100s: %s is for co-simulation only", shown, MODEL_NAME);
        say(functions, shown, fmi2Error, text);
        return NULL;
    }
    I = (Instance *)calloc(1, sizeof(Instance));
    if (!I || !(I->name = (char *)malloc(strlen(shown) + 1))) {
        say(functions, shown, fmi2Error, "there is not enough memory");
        free(I);
        return NULL;
    }
    strcpy(I->name, shown);
    I->resources = folder_of(resources);
    if (functions) {
        I->host = *functions;
    }
    I->exchange = type == fmi2ModelExchange;
    start_values(I);
    return I;
}

void fmi2FreeInstance(fmi2Component c) {
    Instance *I = (Instance *)c;
    if (I) {
        free_tables(I);
        free(I->resources);
        free(I->name);
        free(I);
    }
}

fmi2Status fmi2SetDebugLogging(fmi2Component c, fmi2Boolean on, size_t n, const fmi2String categories[]) {
    (void)on;
    (void)n;
    (void)categories;
    return c ? fmi2OK : fmi2Error;
}

/* State, memory and outputs from start values and inputs. */
static fmi2Status begin(Instance *I) {
    int fault = PY_NO_FAULT;
    if (load_tables(I) != fmi2OK) {
        return fmi2Error;
    }
    model_link(&I->model);
    model_parameters(&I->model, I->values + N_INPUTS + N_OUTPUTS);
    I->step = 1e-3;
    model_begin(&I->model, I->values, I->values + N_INPUTS, I->time, &fault);
    if (!fault) {
        model_coefficients(&I->model, I->step, &fault);
    }
    if (fault) {
        return refuse_fault(I, "initialisation", fault);
    }
#if EXCHANGE
    if (check_exchange(I) != fmi2OK) {
        return fmi2Error;
    }
#endif
    I->begun = 1;
    return I->failed ? fmi2Error : fmi2OK;
}

fmi2Status fmi2SetupExperiment(fmi2Component c, fmi2Boolean hasTolerance, fmi2Real tolerance, fmi2Real start,
                               fmi2Boolean hasStop, fmi2Real stop) {
    Instance *I = (Instance *)c;
    char text[NUMBER_SIZE];
    (void)hasTolerance;
    (void)tolerance;
    (void)hasStop;
    (void)stop;
    if (!I) {
        return fmi2Error;
    }
    if (I->mode != INSTANTIATED) {
        return refuse(I, "fmi2SetupExperiment after fmi2EnterInitializationMode; reset first");
    }
    if (!(-1e9 < start && start < 1e9)) {
        return refuse(I, "start time %s s is refused: it must be a number within 1e9", number(start, text));
    }
    I->time = start;
    return fmi2OK;
}

fmi2Status fmi2EnterInitializationMode(fmi2Component c) {
    static const char *const words[] = {"instantiated", "initialising", "running", "terminated"};
    Instance *I = (Instance *)c;
    if (!I) {
        return fmi2Error;
    }
    if (I->mode != INSTANTIATED) {
        return refuse(I, "fmi2EnterInitializationMode while %s; reset first", words[I->mode]);
    }
    I->mode = INITIALISING;
    return begin(I);
}

fmi2Status fmi2ExitInitializationMode(fmi2Component c) {
    Instance *I = (Instance *)c;
    if (!I) {
        return fmi2Error;
    }
    if (I->mode != INITIALISING) {
        return refuse(I, "fmi2ExitInitializationMode without fmi2EnterInitializationMode");
    }
    if (begin(I) != fmi2OK) {
        return fmi2Error;
    }
    I->mode = RUNNING;
    return fmi2OK;
}

fmi2Status fmi2Terminate(fmi2Component c) {
    Instance *I = (Instance *)c;
    if (!I) {
        return fmi2Error;
    }
    I->mode = TERMINATED;
    return fmi2OK;
}

fmi2Status fmi2Reset(fmi2Component c) {
    Instance *I = (Instance *)c;
    if (!I) {
        return fmi2Error;
    }
    start_values(I);
    return fmi2OK;
}

/* Values */

static int is_integer(fmi2ValueReference r) { return model_integers[r]; }

/* Takes a value if it may be set now and is within its bounds. */
static fmi2Status take(Instance *I, fmi2ValueReference r, double value) {
    if (r < N_VARIABLES && (model_kinds[r] == INPUT || (model_kinds[r] == PARAMETER && I->mode < RUNNING)) &&
        model_lows[r] <= value && value <= model_highs[r]) {
        I->begun = I->begun && I->values[r] == value;
        I->values[r] = value;
        return fmi2OK;
    }
    return refuse_value(I, r, value);
}

fmi2Status fmi2SetReal(fmi2Component c, const fmi2ValueReference r[], size_t n, const fmi2Real values[]) {
    Instance *I = (Instance *)c;
    fmi2Status status = I ? fmi2OK : fmi2Error;
    size_t k;
    for (k = 0; I && k < n; k++) {
        if (r[k] < N_VARIABLES && is_integer(r[k])) {
            status = refuse(I, "%s is an Integer and cannot be set with fmi2SetReal", model_names[r[k]]);
        } else if (take(I, r[k], values[k]) != fmi2OK) {
            status = fmi2Error;
        }
    }
    return status;
}

/* Outputs that follow the inputs at once, as the inputs are now; the others, and those behind a filter or a lag, stay. */
static const double *outputs_now(Instance *I, double outputs[]) {
#if DIRECT
    if (I->mode >= RUNNING && !I->exchange && !I->begun) {
        int fault = PY_NO_FAULT;
        memcpy(outputs, I->values + N_INPUTS, N_OUTPUTS * sizeof *outputs);
        model_direct(&I->model, I->values, outputs, &fault);
        return outputs;
    }
#endif
    (void)outputs;
    return I->values + N_INPUTS;
}

fmi2Status fmi2GetReal(fmi2Component c, const fmi2ValueReference r[], size_t n, fmi2Real values[]) {
    Instance *I = (Instance *)c;
    fmi2Status status = I ? fmi2OK : fmi2Error;
    double outputs[N_OUTPUTS];
    const double *shown;
    size_t k;
    if (I && I->mode == INITIALISING && !I->begun) {
        status = begin(I);
    }
#if EXCHANGE
    if (I && I->exchange && I->mode == RUNNING && !I->begun && !I->failed) {
        double rates[N_STATES + 1];
        status = refresh(I, rates);
        I->begun = status == fmi2OK;
    }
#endif
    shown = I ? outputs_now(I, outputs) : NULL;
    for (k = 0; I && k < n; k++) {
        if (r[k] < N_VARIABLES) {
            values[k] = model_kinds[r[k]] == OUTPUT ? shown[r[k] - N_INPUTS] : I->values[r[k]];
            continue;
        }
#if EXCHANGE
        if (get_local(I, r[k], values + k) == fmi2OK) {
            continue;
        }
#else
        values[k] = NAN;
        refuse_unknown(I, r[k]);
#endif
        status = fmi2Error;
    }
    return status;
}

static fmi2Status refuse_integer(Instance *I, fmi2ValueReference r) {
    return r < N_VARIABLES ? refuse(I, "%s is a Real, not an Integer", model_names[r]) : refuse_unknown(I, r);
}

fmi2Status fmi2SetInteger(fmi2Component c, const fmi2ValueReference r[], size_t n, const fmi2Integer values[]) {
    Instance *I = (Instance *)c;
    fmi2Status status = I ? fmi2OK : fmi2Error;
    size_t k;
    for (k = 0; I && k < n; k++) {
        if (r[k] >= N_VARIABLES || !is_integer(r[k])) {
            status = refuse_integer(I, r[k]);
        } else if (take(I, r[k], (double)values[k]) != fmi2OK) {
            status = fmi2Error;
        }
    }
    return status;
}

fmi2Status fmi2GetInteger(fmi2Component c, const fmi2ValueReference r[], size_t n, fmi2Integer values[]) {
    Instance *I = (Instance *)c;
    fmi2Status status = I ? fmi2OK : fmi2Error;
    size_t k;
    for (k = 0; I && k < n; k++) {
        values[k] = 0;
        if (r[k] >= N_VARIABLES || !is_integer(r[k])) {
            status = refuse_integer(I, r[k]);
        } else {
            values[k] = (fmi2Integer)I->values[r[k]];
        }
    }
    return status;
}

/* There are no Booleans and Strings, so that only empty lists are right. */
static fmi2Status none(fmi2Component c, size_t n, const char *kind) {
    return !c ? fmi2Error : n ? refuse((Instance *)c, "there is no %s variable", kind) : fmi2OK;
}

fmi2Status fmi2GetBoolean(fmi2Component c, const fmi2ValueReference r[], size_t n, fmi2Boolean values[]) {
    (void)r;
    (void)values;
    return none(c, n, "Boolean");
}

fmi2Status fmi2SetBoolean(fmi2Component c, const fmi2ValueReference r[], size_t n, const fmi2Boolean values[]) {
    (void)r;
    (void)values;
    return none(c, n, "Boolean");
}

fmi2Status fmi2GetString(fmi2Component c, const fmi2ValueReference r[], size_t n, fmi2String values[]) {
    (void)r;
    (void)values;
    return none(c, n, "String");
}

fmi2Status fmi2SetString(fmi2Component c, const fmi2ValueReference r[], size_t n, const fmi2String values[]) {
    (void)r;
    (void)values;
    return none(c, n, "String");
}

#include "stepping.h"
