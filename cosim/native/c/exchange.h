/* Model exchange: states, their derivatives and outputs as functions of time, inputs and states, and events; of what is
   sampled a step of co-simulation at each event of the time. */

#ifndef EXCHANGE_H
#define EXCHANGE_H

#if SAMPLED /* no continuous states */
static void model_get_states(const Model *M, double to[]) {
    (void)M;
    (void)to;
}

static void model_set_states(Model *M, const double from[]) {
    (void)M;
    (void)from;
}

static void model_rates(const Model *M, const double inputs[], double motion, const double seeds[], double outputs[],
                        double rates[], double slopes[], int *py_fault) {
    int k;
    (void)M;
    (void)inputs;
    (void)motion;
    (void)seeds;
    (void)rates;
    (void)py_fault;
    for (k = 0; k < N_OUTPUTS; k++) {
        outputs[k] = slopes[k] = NAN;
    }
}
#endif

#if !N_INDICATORS /* nothing ever happens */
static void model_indicators(const Model *M, const double inputs[], double motion, double indicators[], int *py_fault) {
    (void)M;
    (void)inputs;
    (void)motion;
    (void)indicators;
    (void)py_fault;
}

static void model_event(Model *M, const double inputs[], double *motion, int first, int *py_fault) {
    (void)M;
    (void)inputs;
    (void)motion;
    (void)first;
    (void)py_fault;
}
#endif

/* In model exchange nothing can be remembered. */
static Status check_exchange(Instance *I) {
    char a[NUMBER_SIZE], b[NUMBER_SIZE];
    int k;
    for (k = 0; I->exchange && k < N_STILL; k++) {
        if (I->values[model_still[k]] != model_still_at[k]) {
            return refuse(I, "%s = %s is refused in model exchange, since its effect remembers the past or jumps with every reading: it must be %s",
                          model_names[model_still[k]], number(I->values[model_still[k]], a), number(model_still_at[k], b));
        }
    }
    return STATUS_OK;
}

static const double no_seeds[N_INPUTS + N_STATES + 1] = {0};

/* Derivatives, and outputs among the values, at the present states and inputs. */
static Status refresh(Instance *I, double rates[]) {
    double outputs[N_OUTPUTS], slopes[N_OUTPUTS + N_STATES];
    char a[NUMBER_SIZE], text[80];
    int k, fault = PY_NO_FAULT;
    if (SAMPLED) {
        return STATUS_OK; /* outputs are those of the last sample */
    }
    if (check_exchange(I) != STATUS_OK) {
        return STATUS_ERROR;
    }
    model_rates(&I->model, I->values, I->motion, no_seeds, outputs, rates, slopes, &fault);
    for (k = 0; k < N_STATES; k++) {
        fault = fault || isfinite(rates[k]) ? fault : PY_RANGE;
    }
    if (fault) {
        snprintf(text, sizeof text, "the derivatives at t = %s s", number(I->time, a));
        return refuse_fault(I, text, fault);
    }
    memcpy(I->values + N_INPUTS, outputs, sizeof outputs);
    return STATUS_OK;
}

/* A state or a derivative by its value reference, which comes after those of the variables. */
static Status get_local(Instance *I, Reference r, double *value) {
    double numbers[2 * N_STATES + 1];
    const int64_t place = (int64_t)r - N_VARIABLES;
    if (place >= 2 * N_STATES) {
        *value = NAN;
        return refuse_unknown(I, r);
    }
    model_get_states(&I->model, numbers);
    if (place >= N_STATES) {
        int fault = PY_NO_FAULT;
        double outputs[N_OUTPUTS], slopes[N_OUTPUTS + N_STATES];
        model_rates(&I->model, I->values, I->motion, no_seeds, outputs, numbers + N_STATES, slopes, &fault);
        if (fault) {
            *value = NAN; /* a step may still be possible: what remembers the past has steps but no derivative */
            return STATUS_OK;
        }
    }
    *value = numbers[place];
    return STATUS_OK;
}

/* Model exchange calls this while it runs; what is only read may be asked for during initialisation too. */
static Status in_exchange(Instance *I, const char *call, int reads) {
    if (!I->exchange || !(I->mode == RUNNING || (reads && I->mode == INITIALISING))) {
        return refuse(I, FMI "%s is for model exchange, after initialisation", call);
    }
    return I->failed ? STATUS_ERROR : STATUS_OK;
}

/* As above, where the host gives room for as many numbers as there are states, or none. */
static Status check_count(Instance *I, const char *call, int reads, size_t n, size_t wanted) {
    if (in_exchange(I, call, reads) != STATUS_OK) {
        return STATUS_ERROR;
    }
    return n == wanted ? STATUS_OK
                       : refuse(I, FMI "%s: there are %lu numbers, not %lu", call, (unsigned long)wanted, (unsigned long)n);
}

static Status set_time(Instance *I, double time) {
    char text[NUMBER_SIZE];
    if (in_exchange(I, "SetTime", 0) != STATUS_OK) {
        return STATUS_ERROR;
    }
    if (!(-1e9 < time && time < 1e9)) {
        return refuse(I, "time %s s is refused: it must be a number within 1e9", number(time, text));
    }
    I->time = time;
    return STATUS_OK;
}

static Status set_states(Instance *I, const double x[], size_t n) {
    char text[NUMBER_SIZE];
    size_t k;
    if (check_count(I, "SetContinuousStates", 0, n, N_STATES) != STATUS_OK) {
        return STATUS_ERROR;
    }
    for (k = 0; k < n; k++) {
        if (!isfinite(x[k])) {
            return refuse(I, "state %lu = %s is refused: it must be a number", (unsigned long)k, number(x[k], text));
        }
    }
    model_set_states(&I->model, x);
    I->begun = 0;
    return STATUS_OK;
}

static Status begin(Instance *I);

static Status get_states(Instance *I, double x[], size_t n) {
    if (check_count(I, "GetContinuousStates", 1, n, N_STATES) != STATUS_OK ||
        (I->mode == INITIALISING && !I->begun && begin(I) != STATUS_OK)) {
        return STATUS_ERROR;
    }
    model_get_states(&I->model, x);
    return STATUS_OK;
}

static Status get_rates(Instance *I, const char *call, double rates[], size_t n) {
    double found[N_STATES + 1];
    if (check_count(I, call, 1, n, N_STATES) != STATUS_OK ||
        (I->mode == INITIALISING && !I->begun && begin(I) != STATUS_OK) || refresh(I, found) != STATUS_OK) {
        return STATUS_ERROR;
    }
    memcpy(rates, found, N_STATES * sizeof *found);
    I->begun = 1;
    return STATUS_OK;
}

/* Event indicators, at the present states and inputs. */
static Status get_indicators(Instance *I, double found[], size_t n) {
    int fault = PY_NO_FAULT;
    if (check_count(I, "GetEventIndicators", 1, n, N_INDICATORS) != STATUS_OK ||
        (I->mode == INITIALISING && !I->begun && begin(I) != STATUS_OK)) {
        return STATUS_ERROR;
    }
    model_indicators(&I->model, I->values, I->motion, found, &fault);
    return fault ? refuse_fault(I, FMI "GetEventIndicators", fault) : STATUS_OK;
}

#if FMI_VERSION == 3 /* which shows them among its variables */
/* One of them as a variable; in co-simulation that of the motion that begins in the present state. */
static double one_indicator(Instance *I, int k) {
    double found[N_INDICATORS + 1], motion = I->motion;
    int fault = PY_NO_FAULT;
    if (!I->exchange) {
        model_event(&I->model, I->values, &motion, 1, &fault);
    }
    model_indicators(&I->model, I->values, motion, found, &fault);
    return fault ? NAN : found[k];
}
#endif

/* The first sample is taken one interval after the start, from the inputs of then and of now. */
static void begin_samples(Instance *I) {
    I->begun_at = I->time;
    I->samples = 1.0;
    memcpy(I->held, I->values, sizeof I->held);
}

static double next_sample(const Instance *I) { return I->begun_at + I->samples * I->step; }

#define MOST_SAMPLES 1e5 /* passed by at once: a host that goes farther has lost its way, and they would take for ever */

/* The samples that are due; of one that the host passed by the inputs are those of now. */
static Status take_samples(Instance *I, const char *call) {
    double inputs[N_INPUTS + 1];
    char a[NUMBER_SIZE], b[NUMBER_SIZE];
    int k;
    if (I->time > next_sample(I) + MOST_SAMPLES * I->step) {
        return refuse(I, FMI "%s at t = %s s: the next sample was due at %s s", call, number(I->time, a),
                      number(next_sample(I), b));
    }
    while (I->time > next_sample(I) - 1e-6 * I->step) { /* hosts keep the time with rounding jitter */
        for (k = 0; k < N_INPUTS; k++) {
            inputs[k] = model_reads[k] == AS_HELD || model_reads[k] == AT_START ? I->held[k] : I->values[k];
        }
        if (step_with(I, inputs, next_sample(I) - I->step, next_sample(I)) != STATUS_OK) {
            return STATUS_ERROR;
        }
        memcpy(I->held, I->values, sizeof I->held);
        I->samples += 1.0;
    }
    if (I->samples == 1.0) {
        memcpy(I->held, I->values, sizeof I->held); /* what hosts connect is known only now */
    }
    return STATUS_OK;
}

/* The state after an event, and the motion that begins there; says whether states have jumped. So it does where derivatives
   have: some hosts begin anew only then. */
static Status make_event(Instance *I, const char *call, int *jumped) {
    double before[N_STATES + 1], after[N_STATES + 1];
    const double motion = I->motion;
    int k, fault = PY_NO_FAULT;
    *jumped = 0;
    if (in_exchange(I, call, 0) != STATUS_OK) {
        return STATUS_ERROR;
    }
    if (SAMPLED) {
        return take_samples(I, call);
    }
    model_get_states(&I->model, before);
    model_event(&I->model, I->values, &I->motion, 0, &fault);
    model_get_states(&I->model, after);
    *jumped = I->motion != motion;
    for (k = 0; k < N_STATES; k++) {
        *jumped = *jumped || before[k] != after[k];
    }
    I->begun = 0; /* outputs follow anew */
    return fault ? refuse_fault(I, call, fault) : STATUS_OK;
}

static Status get_nominals(Instance *I, double nominals[], size_t n) {
    if (check_count(I, "GetNominalsOfContinuousStates", 1, n, N_STATES) != STATUS_OK) {
        return STATUS_ERROR;
    }
    memcpy(nominals, model_nominals, N_STATES * sizeof *nominals);
    return STATUS_OK;
}

/* Place among the seeds (inputs, then states) of what derivatives are by, or -1 and a message. */
static int known(Instance *I, Reference r) {
    const int64_t place = r, first = N_VARIABLES;
    if (SAMPLED) {
        refuse(I, "there are no directional derivatives: %s is sampled", MODEL_NAME);
        return -1;
    }
    if (place < N_INPUTS) {
        return (int)place;
    }
    if (place >= first && place < first + N_STATES) {
        return (int)(place - first) + N_INPUTS;
    }
    refuse(I, "directional derivatives are by inputs and states, and number %u is neither", (unsigned)r);
    return -1;
}

/* Place among the slopes (outputs, then derivatives) of what derivatives are of, or -1 and a message. */
static int unknown(Instance *I, Reference r) {
    const int64_t place = r, first = N_VARIABLES + N_STATES;
    if (place >= N_INPUTS && place < N_INPUTS + N_OUTPUTS) {
        return (int)place - N_INPUTS;
    }
    if (place >= first && place < first + N_STATES) {
        return (int)(place - first) + N_OUTPUTS;
    }
    refuse(I, "directional derivatives are of outputs and derivatives, and number %u is neither", (unsigned)r);
    return -1;
}

/* Exact, from the equations: slopes of outputs and derivatives in a direction of inputs and states. */
static Status slopes_along(Instance *I, const char *call, const double seeds[], double slopes[]) {
    double outputs[N_OUTPUTS], rates[N_STATES + 1];
    int fault = PY_NO_FAULT;
    model_rates(&I->model, I->values, I->motion, seeds, outputs, rates, slopes, &fault);
    return fault ? refuse_fault(I, call, fault) : STATUS_OK;
}

static Status no_slope(Instance *I) { return refuse(I, "there is no directional derivative at this place"); }

static Status directional(Instance *I, const Reference unknowns[], size_t n_unknowns, const Reference knowns[],
                          size_t n_knowns, const double seed[], double sensitivity[]) {
    double seeds[N_INPUTS + N_STATES + 1] = {0}, slopes[N_OUTPUTS + N_STATES];
    size_t k;
    if (in_exchange(I, "GetDirectionalDerivative", 0) != STATUS_OK || check_exchange(I) != STATUS_OK) {
        return STATUS_ERROR;
    }
    for (k = 0; k < n_knowns; k++) {
        const int at = known(I, knowns[k]);
        if (at < 0) {
            return STATUS_ERROR;
        }
        seeds[at] += seed[k];
    }
    if (slopes_along(I, FMI "GetDirectionalDerivative", seeds, slopes) != STATUS_OK) {
        return STATUS_ERROR;
    }
    for (k = 0; k < n_unknowns; k++) {
        const int at = unknown(I, unknowns[k]);
        if (at < 0) {
            return STATUS_ERROR;
        }
        sensitivity[k] = slopes[at];
        if (!isfinite(sensitivity[k])) {
            return no_slope(I);
        }
    }
    return STATUS_OK;
}

#if FMI_VERSION == 3
/* The transposed matrix times the seed: a direction for each known, since there are few. */
static Status adjoint(Instance *I, const Reference unknowns[], size_t n_unknowns, const Reference knowns[], size_t n_knowns,
                      const double seed[], double sensitivity[]) {
    size_t j, k;
    if (in_exchange(I, "GetAdjointDerivative", 0) != STATUS_OK || check_exchange(I) != STATUS_OK) {
        return STATUS_ERROR;
    }
    for (j = 0; j < n_knowns; j++) {
        double seeds[N_INPUTS + N_STATES + 1] = {0}, slopes[N_OUTPUTS + N_STATES];
        const int along = known(I, knowns[j]);
        if (along < 0) {
            return STATUS_ERROR;
        }
        seeds[along] = 1.0;
        if (slopes_along(I, FMI "GetAdjointDerivative", seeds, slopes) != STATUS_OK) {
            return STATUS_ERROR;
        }
        sensitivity[j] = 0.0;
        for (k = 0; k < n_unknowns; k++) {
            const int at = unknown(I, unknowns[k]);
            if (at < 0) {
                return STATUS_ERROR;
            }
            sensitivity[j] += seed[k] * slopes[at];
        }
        if (!isfinite(sensitivity[j])) {
            return no_slope(I);
        }
    }
    return STATUS_OK;
}
#endif

#endif
