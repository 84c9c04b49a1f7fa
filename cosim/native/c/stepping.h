/* Steps, with inputs that may move by their derivatives. */

#ifndef STEPPING_H
#define STEPPING_H

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

static Status move_inputs(const Instance *I, double h, double inputs[]) {
    int k;
    for (k = 0; k < N_INPUTS; k++) {
        inputs[k] = moved_input(I, k, h);
        if (!(model_lows[k] <= inputs[k] && inputs[k] <= model_highs[k])) {
            return refuse_value((Instance *)I, (Reference)k, inputs[k]);
        }
    }
    return STATUS_OK;
}

/* Whether a step of this size can be made; takes the coefficients of another size than the last one's. */
static Status prepare(Instance *I, double time, double step) {
    char a[NUMBER_SIZE], b[160];
    int fault = PY_NO_FAULT;
    if (I->exchange) {
        return refuse(I, FMI "DoStep in model exchange");
    }
    if (I->mode == TERMINATED) {
        return refuse(I, FMI "DoStep after " FMI "Terminate; reset first");
    }
    if (I->mode != RUNNING) {
        return refuse(I, FMI "DoStep before initialisation is complete");
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
    return STATUS_OK;
}

/* The step from `time` to `end` with these inputs, in co-simulation and at a sample of model exchange. */
static Status step_with(Instance *I, const double inputs[], double time, double end) {
    double outputs[N_OUTPUTS];
    char a[NUMBER_SIZE], b[NUMBER_SIZE], text[160];
    double sizes = 0.0;
    int k, fault = PY_NO_FAULT;
    memcpy(outputs, I->values + N_INPUTS, sizeof outputs);
    model_step(&I->model, inputs, outputs, end, &fault);
    if (fault) {
        snprintf(text, sizeof text, "the step at t = %s s", number(time, a));
        return refuse_fault(I, text, fault);
    }
    for (k = 0; k < N_OUTPUTS; k++) {
        sizes += fabs(outputs[k]);
    }
    for (k = 0; !(sizes < 1e300) && k < N_OUTPUTS; k++) { /* one of them may be no finite number */
        if (!(-1e300 < outputs[k] && outputs[k] < 1e300)) {
            return refuse(I, "the step at t = %s s failed: %s = %s", number(time, a), model_names[N_INPUTS + k],
                          number(outputs[k], b));
        }
    }
    memcpy(I->values + N_INPUTS, outputs, sizeof outputs);
    return STATUS_OK;
}

static Status make_step(Instance *I, double time, double step) {
    double moved[N_INPUTS + 1], *inputs;
    if (I->failed || prepare(I, time, step) != STATUS_OK) {
        return STATUS_ERROR;
    }
    inputs = I->values;
    if (I->slopes) {
        if (move_inputs(I, step, moved) != STATUS_OK) {
            return STATUS_ERROR;
        }
        inputs = moved;
        I->slopes = 0;
        memset(I->derivatives, 0, sizeof I->derivatives);
    }
    if (step_with(I, inputs, time, time + step) != STATUS_OK) {
        return STATUS_ERROR;
    }
    I->begun = 1;
    I->time = time + step;
    return STATUS_OK;
}

#endif
