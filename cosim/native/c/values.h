/* Values of variables, set and got: real and whole numbers. */

#ifndef VALUES_H
#define VALUES_H

static int is_whole(Reference r) { return model_integers[r]; }

/* Takes a value if it may be set now and is within its bounds. */
static Status take(Instance *I, Reference r, double value) {
    if (r < N_VARIABLES && (model_kinds[r] == INPUT || (model_kinds[r] == PARAMETER && I->mode < RUNNING)) &&
        model_lows[r] <= value && value <= model_highs[r]) {
        I->begun = I->begun && I->values[r] == value;
        I->values[r] = value;
        return STATUS_OK;
    }
    return refuse_value(I, r, value);
}

static Status set_reals(Instance *I, const Reference r[], size_t n, const double values[]) {
    Status status = STATUS_OK;
    size_t k;
    for (k = 0; k < n; k++) {
        if (r[k] < N_VARIABLES && is_whole(r[k])) {
            status = refuse(I, "%s is an " WHOLE " and cannot be set with " FMI "Set" REAL, model_names[r[k]]);
        } else if (take(I, r[k], values[k]) != STATUS_OK) {
            status = STATUS_ERROR;
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

static Status get_reals(Instance *I, const Reference r[], size_t n, double values[]) {
    Status status = STATUS_OK;
    double outputs[N_OUTPUTS];
    const double *shown;
    size_t k;
    if (I->mode == INITIALISING && !I->begun) {
        status = begin(I);
    }
    if (I->exchange && I->mode == RUNNING && !I->begun && !I->failed) {
        double rates[N_STATES + 1];
        status = refresh(I, rates);
        I->begun = status == STATUS_OK;
    }
    shown = outputs_now(I, outputs);
    /* outputs first and quickly: unsigned, so that what is no output lies beyond; none is a whole number */
    for (k = 0; k < n && r[k] - N_INPUTS < N_OUTPUTS; k++) {
        values[k] = shown[r[k] - N_INPUTS];
    }
    for (; k < n; k++) {
#if FMI_VERSION == 3 /* which has the time among its variables, and is strict about their types */
        if (r[k] == TIME) {
            values[k] = I->time;
            continue;
        }
        if (r[k] > TIME && r[k] <= TIME + N_INDICATORS) {
            values[k] = one_indicator(I, (int)(r[k] - TIME) - 1);
            continue;
        }
        if (r[k] < N_VARIABLES && is_whole(r[k])) {
            values[k] = NAN;
            status = refuse(I, "%s is an " WHOLE " and cannot be got with " FMI "Get" REAL, model_names[r[k]]);
            continue;
        }
#endif
        if (r[k] < N_VARIABLES) {
            values[k] = model_kinds[r[k]] == OUTPUT ? shown[r[k] - N_INPUTS] : I->values[r[k]];
        } else if (get_local(I, r[k], values + k) != STATUS_OK) {
            status = STATUS_ERROR;
        }
    }
    return status;
}

static Status refuse_whole(Instance *I, Reference r) {
    return r < N_VARIABLES ? refuse(I, "%s is a " REAL ", not an " WHOLE, model_names[r]) : refuse_unknown(I, r);
}

static Status set_wholes(Instance *I, const Reference r[], size_t n, const int32_t values[]) {
    Status status = STATUS_OK;
    size_t k;
    for (k = 0; k < n; k++) {
        if (r[k] >= N_VARIABLES || !is_whole(r[k])) {
            status = refuse_whole(I, r[k]);
        } else if (take(I, r[k], (double)values[k]) != STATUS_OK) {
            status = STATUS_ERROR;
        }
    }
    return status;
}

static Status get_wholes(Instance *I, const Reference r[], size_t n, int32_t values[]) {
    Status status = STATUS_OK;
    size_t k;
    for (k = 0; k < n; k++) {
        values[k] = 0;
        if (r[k] >= N_VARIABLES || !is_whole(r[k])) {
            status = refuse_whole(I, r[k]);
        } else {
            values[k] = (int32_t)I->values[r[k]];
        }
    }
    return status;
}

/* There are no variables of another kind, so that only empty lists are right. */
static Status none(Instance *I, size_t n, const char *kind) {
    return n ? refuse(I, "there is no %s variable", kind) : STATUS_OK;
}

#endif
