/* Model exchange: states, their derivatives and outputs as functions of time, inputs and states. There are no events. */

#ifndef EXCHANGE_H
#define EXCHANGE_H

/* In model exchange nothing can be remembered, and an effect with events would need them announced. */
static fmi2Status check_exchange(Instance *I) {
    char a[NUMBER_SIZE], b[NUMBER_SIZE];
    int k;
    for (k = 0; I->exchange && k < N_STILL; k++) {
        if (I->values[model_still[k]] != model_still_at[k]) {
            return refuse(I, "%s = %s is refused in model exchange, since its effect has events or remembers the past: it must be %s",
                          model_names[model_still[k]], number(I->values[model_still[k]], a), number(model_still_at[k], b));
        }
    }
    return fmi2OK;
}

static const double no_seeds[N_INPUTS + N_STATES + 1] = {0};

/* Derivatives, and outputs among the values, at the present states and inputs. */
static fmi2Status refresh(Instance *I, double rates[]) {
    double outputs[N_OUTPUTS], slopes[N_OUTPUTS + N_STATES];
    char a[NUMBER_SIZE], text[80];
    int k, fault = PY_NO_FAULT;
    if (check_exchange(I) != fmi2OK) {
        return fmi2Error;
    }
    model_rates(&I->model, I->values, no_seeds, outputs, rates, slopes, &fault);
    for (k = 0; k < N_STATES; k++) {
        fault = fault || isfinite(rates[k]) ? fault : PY_RANGE;
    }
    if (fault) {
        snprintf(text, sizeof text, "the derivatives at t = %s s", number(I->time, a));
        return refuse_fault(I, text, fault);
    }
    memcpy(I->values + N_INPUTS, outputs, sizeof outputs);
    return fmi2OK;
}

/* A state or a derivative by its value reference, which comes after those of the variables. */
static fmi2Status get_local(Instance *I, fmi2ValueReference r, double *value) {
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
        model_rates(&I->model, I->values, no_seeds, outputs, numbers + N_STATES, slopes, &fault);
        if (fault) {
            *value = NAN; /* a step may still be possible: dry friction has steps but no derivative */
            return fmi2OK;
        }
    }
    *value = numbers[place];
    return fmi2OK;
}

static fmi2Status in_exchange(fmi2Component c, const char *call) {
    Instance *I = (Instance *)c;
    if (!I) {
        return fmi2Error;
    }
    if (!I->exchange || I->mode != RUNNING) {
        return refuse(I, "%s is for model exchange, after initialisation", call);
    }
    return I->failed ? fmi2Error : fmi2OK;
}

fmi2Status fmi2EnterEventMode(fmi2Component c) { return in_exchange(c, "fmi2EnterEventMode"); }

fmi2Status fmi2EnterContinuousTimeMode(fmi2Component c) { return in_exchange(c, "fmi2EnterContinuousTimeMode"); }

fmi2Status fmi2NewDiscreteStates(fmi2Component c, fmi2EventInfo *info) {
    memset(info, 0, sizeof *info); /* nothing to iterate, no event to come, no end */
    return in_exchange(c, "fmi2NewDiscreteStates");
}

fmi2Status fmi2CompletedIntegratorStep(fmi2Component c, fmi2Boolean noSetFMUStatePriorToCurrentPoint,
                                       fmi2Boolean *enterEventMode, fmi2Boolean *terminateSimulation) {
    (void)noSetFMUStatePriorToCurrentPoint;
    *enterEventMode = *terminateSimulation = fmi2False;
    return in_exchange(c, "fmi2CompletedIntegratorStep");
}

fmi2Status fmi2SetTime(fmi2Component c, fmi2Real time) {
    Instance *I = (Instance *)c;
    char text[NUMBER_SIZE];
    if (in_exchange(c, "fmi2SetTime") != fmi2OK) {
        return fmi2Error;
    }
    if (!(-1e9 < time && time < 1e9)) {
        return refuse(I, "time %s s is refused: it must be a number within 1e9", number(time, text));
    }
    I->time = time;
    return fmi2OK;
}

static fmi2Status check_count(fmi2Component c, const char *call, size_t n, size_t wanted) {
    if (in_exchange(c, call) != fmi2OK) {
        return fmi2Error;
    }
    return n == wanted ? fmi2OK
                       : refuse((Instance *)c, "%s: there are %lu numbers, not %lu", call, (unsigned long)wanted, (unsigned long)n);
}

fmi2Status fmi2SetContinuousStates(fmi2Component c, const fmi2Real x[], size_t n) {
    Instance *I = (Instance *)c;
    char text[NUMBER_SIZE];
    size_t k;
    if (check_count(c, "fmi2SetContinuousStates", n, N_STATES) != fmi2OK) {
        return fmi2Error;
    }
    for (k = 0; k < n; k++) {
        if (!isfinite(x[k])) {
            return refuse(I, "state %lu = %s is refused: it must be a number", (unsigned long)k, number(x[k], text));
        }
    }
    model_set_states(&I->model, x);
    I->begun = 0;
    return fmi2OK;
}

fmi2Status fmi2GetContinuousStates(fmi2Component c, fmi2Real x[], size_t n) {
    if (check_count(c, "fmi2GetContinuousStates", n, N_STATES) != fmi2OK) {
        return fmi2Error;
    }
    model_get_states(&((Instance *)c)->model, x);
    return fmi2OK;
}

fmi2Status fmi2GetDerivatives(fmi2Component c, fmi2Real rates[], size_t n) {
    double found[N_STATES + 1];
    if (check_count(c, "fmi2GetDerivatives", n, N_STATES) != fmi2OK || refresh((Instance *)c, found) != fmi2OK) {
        return fmi2Error;
    }
    memcpy(rates, found, N_STATES * sizeof *found);
    ((Instance *)c)->begun = 1;
    return fmi2OK;
}

/* Exact, from the equations: of outputs and derivatives by inputs and states. */
fmi2Status fmi2GetDirectionalDerivative(fmi2Component c, const fmi2ValueReference unknowns[], size_t n_unknowns,
                                        const fmi2ValueReference knowns[], size_t n_knowns, const fmi2Real seed[],
                                        fmi2Real sensitivity[]) {
    Instance *I = (Instance *)c;
    double seeds[N_INPUTS + N_STATES + 1] = {0}, outputs[N_OUTPUTS], rates[N_STATES + 1], slopes[N_OUTPUTS + N_STATES];
    const fmi2ValueReference first = N_VARIABLES, last = N_VARIABLES + N_STATES;
    int fault = PY_NO_FAULT;
    size_t k;
    if (in_exchange(c, "fmi2GetDirectionalDerivative") != fmi2OK || check_exchange(I) != fmi2OK) {
        return fmi2Error;
    }
    for (k = 0; k < n_knowns; k++) {
        const fmi2ValueReference r = knowns[k];
        if (r >= N_INPUTS && (r < first || r >= last)) {
            return refuse(I, "directional derivatives are by inputs and states, and number %u is neither", (unsigned)r);
        }
        seeds[r < N_INPUTS ? r : r - first + N_INPUTS] += seed[k];
    }
    model_rates(&I->model, I->values, seeds, outputs, rates, slopes, &fault);
    if (fault) {
        return refuse_fault(I, "fmi2GetDirectionalDerivative", fault);
    }
    for (k = 0; k < n_unknowns; k++) {
        const fmi2ValueReference r = unknowns[k];
        if ((r < N_INPUTS || r >= N_INPUTS + N_OUTPUTS) && (r < last || r >= last + N_STATES)) {
            return refuse(I, "directional derivatives are of outputs and derivatives, and number %u is neither", (unsigned)r);
        }
        sensitivity[k] = slopes[r < last ? r - N_INPUTS : r - last + N_OUTPUTS];
        if (!isfinite(sensitivity[k])) {
            return refuse(I, "there is no directional derivative at this place");
        }
    }
    return fmi2OK;
}

fmi2Status fmi2GetEventIndicators(fmi2Component c, fmi2Real indicators[], size_t n) {
    (void)indicators;
    return check_count(c, "fmi2GetEventIndicators", n, 0);
}

fmi2Status fmi2GetNominalsOfContinuousStates(fmi2Component c, fmi2Real nominals[], size_t n) {
    if (check_count(c, "fmi2GetNominalsOfContinuousStates", n, N_STATES) != fmi2OK) {
        return fmi2Error;
    }
    memcpy(nominals, model_nominals, N_STATES * sizeof *nominals);
    return fmi2OK;
}

#endif
