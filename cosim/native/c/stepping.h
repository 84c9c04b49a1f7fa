/* Steps, derivatives of inputs, and the state as FMI hands it out. */

#ifndef STEPPING_H
#define STEPPING_H

/* Derivatives hold for the next step only. */
fmi2Status fmi2SetRealInputDerivatives(fmi2Component c, const fmi2ValueReference r[], size_t n, const fmi2Integer order[],
                                       const fmi2Real values[]) {
    Instance *I = (Instance *)c;
    fmi2Status status = I ? fmi2OK : fmi2Error;
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
    return status;
}

fmi2Status fmi2GetRealOutputDerivatives(fmi2Component c, const fmi2ValueReference r[], size_t n, const fmi2Integer order[],
                                        fmi2Real values[]) {
    (void)r;
    (void)order;
    (void)values;
    return !c ? fmi2Error : n ? refuse((Instance *)c, "derivatives of outputs are not provided") : fmi2OK;
}

/* An input over the step by its derivatives: at the end, on average where the equations hold it, or as it begins. */
static double moved_input(const Instance *I, int k, double h) {
    const double *d = I->derivatives[k];
    if (model_reads[k] == AT_START) {
        return I->values[k];
    }
    if (model_reads[k] == AS_HELD) {
        return I->values[k] + h * (d[0] / 2.0 + h * (d[1] / 6.0 + h * d[2] / 24.0));
    }
    return I->values[k] + h * (d[0] + h * (d[1] / 2.0 + h * d[2] / 6.0));
}

static fmi2Status move_inputs(const Instance *I, double h, double inputs[]) {
    int k;
    for (k = 0; k < N_INPUTS; k++) {
        inputs[k] = moved_input(I, k, h);
        if (!(model_lows[k] <= inputs[k] && inputs[k] <= model_highs[k])) {
            return refuse_value((Instance *)I, (fmi2ValueReference)k, inputs[k]);
        }
    }
    return fmi2OK;
}

/* Whether a step of this size can be made; takes the coefficients of another size than the last one's. */
static fmi2Status prepare(Instance *I, double time, double step) {
    char a[NUMBER_SIZE], b[160];
    int fault = PY_NO_FAULT;
    if (I->exchange) {
        return refuse(I, "fmi2DoStep in model exchange");
    }
    if (I->mode == TERMINATED) {
        return refuse(I, "fmi2DoStep after fmi2Terminate; reset first");
    }
    if (I->mode != RUNNING) {
        return refuse(I, "fmi2DoStep before initialisation is complete");
    }
    if (!(0.0 < step && step < 1e6)) {
        return refuse(I, "step size %s s is refused: it must be positive and below 1e6", number(step, a));
    }
    if (TAKES_TIME && !(-1e9 < time && time < 1e9)) {
        return refuse(I, "communication time %s s is refused: it must be a number within 1e9", number(time, a));
    }
    /* masters pass steps with rounding jitter */
    if (!(I->step * (1.0 - 1e-12) < step && step < I->step * (1.0 + 1e-12))) {
        model_coefficients(&I->model, step, &fault);
        if (fault) {
            snprintf(b, sizeof b, "the step at t = %s s", number(time, a));
            return refuse_fault(I, b, fault);
        }
        I->step = step;
    }
    return fmi2OK;
}

fmi2Status fmi2DoStep(fmi2Component c, fmi2Real time, fmi2Real step, fmi2Boolean noSetFMUStatePriorToCurrentPoint) {
    Instance *I = (Instance *)c;
    double outputs[N_OUTPUTS], moved[N_INPUTS + 1], *inputs;
    char a[NUMBER_SIZE], b[NUMBER_SIZE], text[160];
    int k, fault = PY_NO_FAULT;
    (void)noSetFMUStatePriorToCurrentPoint;
    if (!I || I->failed || prepare(I, time, step) != fmi2OK) {
        return fmi2Error;
    }
    inputs = I->values;
    if (I->slopes) {
        if (move_inputs(I, step, moved) != fmi2OK) {
            return fmi2Error;
        }
        inputs = moved;
        I->slopes = 0;
        memset(I->derivatives, 0, sizeof I->derivatives);
    }
    memcpy(outputs, I->values + N_INPUTS, sizeof outputs);
    model_step(&I->model, inputs, outputs, time + step, &fault);
    if (fault) {
        snprintf(text, sizeof text, "the step at t = %s s", number(time, a));
        return refuse_fault(I, text, fault);
    }
    for (k = 0; k < N_OUTPUTS; k++) {
        if (!(-1e300 < outputs[k] && outputs[k] < 1e300)) {
            return refuse(I, "the step at t = %s s failed: %s = %s", number(time, a), model_names[N_INPUTS + k],
                          number(outputs[k], b));
        }
    }
    memcpy(I->values + N_INPUTS, outputs, sizeof outputs);
    I->begun = 1;
    I->time = time + step;
    return fmi2OK;
}

fmi2Status fmi2CancelStep(fmi2Component c) {
    return c ? refuse((Instance *)c, "fmi2CancelStep: no step runs in the background") : fmi2Error;
}

fmi2Status fmi2GetStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Status *value) {
    (void)kind;
    if (!c) {
        return fmi2Error;
    }
    *value = ((Instance *)c)->failed ? fmi2Error : fmi2OK; /* no step is ever pending */
    return fmi2OK;
}

fmi2Status fmi2GetRealStatus(fmi2Component c, const fmi2StatusKind kind, fmi2Real *value) {
    if (!c || kind != fmi2LastSuccessfulTime) {
        return fmi2Discard;
    }
    *value = ((Instance *)c)->time;
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

/* The whole state; only here and in fmi2DeSerializeFMUstate is memory taken, and given back by fmi2FreeFMUstate */

fmi2Status fmi2GetFMUstate(fmi2Component c, fmi2FMUstate *state) {
    if (!c) {
        return fmi2Error;
    }
    if (!*state && !(*state = malloc(sizeof(Saved)))) {
        return refuse((Instance *)c, "there is not enough memory for a state");
    }
    save((Instance *)c, (Saved *)*state);
    return fmi2OK;
}

fmi2Status fmi2SetFMUstate(fmi2Component c, fmi2FMUstate state) {
    if (!c) {
        return fmi2Error;
    }
    return state ? restore((Instance *)c, (const Saved *)state)
                 : refuse((Instance *)c, "the state cannot be restored: there is none");
}

fmi2Status fmi2FreeFMUstate(fmi2Component c, fmi2FMUstate *state) {
    (void)c;
    if (state) {
        free(*state);
        *state = NULL;
    }
    return fmi2OK;
}

fmi2Status fmi2SerializedFMUstateSize(fmi2Component c, fmi2FMUstate state, size_t *size) {
    (void)state;
    *size = sizeof(Saved);
    return c ? fmi2OK : fmi2Error;
}

fmi2Status fmi2SerializeFMUstate(fmi2Component c, fmi2FMUstate state, fmi2Byte bytes[], size_t size) {
    if (!c) {
        return fmi2Error;
    }
    if (!state || size < sizeof(Saved)) {
        return refuse((Instance *)c, "a state needs %lu bytes, not %lu", (unsigned long)sizeof(Saved), (unsigned long)size);
    }
    memcpy(bytes, state, sizeof(Saved));
    return fmi2OK;
}

fmi2Status fmi2DeSerializeFMUstate(fmi2Component c, const fmi2Byte bytes[], size_t size, fmi2FMUstate *state) {
    if (!c) {
        return fmi2Error;
    }
    if (size != sizeof(Saved)) {
        return refuse((Instance *)c, "the state cannot be restored: it was not saved by %s %s: it has %lu bytes, not %lu",
                      MODEL_NAME, MODEL_GUID, (unsigned long)size, (unsigned long)sizeof(Saved));
    }
    if (!*state && !(*state = malloc(sizeof(Saved)))) {
        return refuse((Instance *)c, "there is not enough memory for a state");
    }
    memcpy(*state, bytes, sizeof(Saved));
    return fmi2OK;
}

#if !EXCHANGE
fmi2Status fmi2GetDirectionalDerivative(fmi2Component c, const fmi2ValueReference unknowns[], size_t n_unknowns,
                                        const fmi2ValueReference knowns[], size_t n_knowns, const fmi2Real seed[],
                                        fmi2Real sensitivity[]) {
    (void)unknowns;
    (void)n_unknowns;
    (void)knowns;
    (void)n_knowns;
    (void)seed;
    (void)sensitivity;
    return c ? refuse((Instance *)c, "directional derivatives are not provided: %s is for co-simulation only", MODEL_NAME) : fmi2Error;
}
#endif

#endif
