/* The whole state of an instance as one block of bytes: saved, restored, handed to another process of the same platform. */

#ifndef SAVED_H
#define SAVED_H

#define MAGIC UINT64_C(0x31306574617473) /* reads differently where the order of bytes is another one */

typedef struct {
    uint64_t magic;
    char guid[64];
    int32_t mode, failed, begun, slopes;
    double time, step;
    double values[N_VARIABLES];
    double derivatives[N_INPUTS + 1][ORDERS];
    double numbers[N_NUMBERS + 1];
    double motion, begun_at, samples;
    double held[N_INPUTS + 1];
} Saved;

static void save(Instance *I, Saved *s) {
    memset(s, 0, sizeof *s);
    s->magic = MAGIC;
    strcpy(s->guid, MODEL_GUID);
    s->mode = I->mode;
    s->failed = I->failed;
    s->begun = I->begun;
    s->slopes = I->slopes;
    s->time = I->time;
    s->step = I->step;
    s->motion = I->motion;
    s->begun_at = I->begun_at;
    s->samples = I->samples;
    memcpy(s->held, I->held, sizeof s->held);
    memcpy(s->values, I->values, sizeof s->values);
    memcpy(s->derivatives, I->derivatives, sizeof s->derivatives);
    model_save(&I->model, s->numbers);
}

/* What keeps a saved state from being restored, or NULL. */
static const char *flaw(const Saved *s) {
    const double *d = s->derivatives[0];
    int k, beyond = 0, bad = !isfinite(s->time) || !isfinite(s->step) || s->step <= 0.0 || !isfinite(s->motion) ||
                             !isfinite(s->begun_at) || !(0.0 <= s->samples && s->samples < 1e15);
    if (s->magic != MAGIC || strcmp(s->guid, MODEL_GUID) != 0) {
        return "it was not saved by " MODEL_NAME " " MODEL_GUID " on a platform like this";
    }
    if (s->mode < INSTANTIATED || s->mode > TERMINATED) {
        return "it does not fit";
    }
    for (k = 0; k < N_VARIABLES; k++) {
        bad = bad || !isfinite(s->values[k]);
        /* what no setter takes no state may bring in either: an Integer is read back as one */
        beyond = beyond || ((model_kinds[k] == INPUT || model_kinds[k] == PARAMETER) &&
                            !(model_lows[k] <= s->values[k] && s->values[k] <= model_highs[k]));
    }
    for (k = 0; k < N_INPUTS + 1; k++) {
        bad = bad || !isfinite(s->held[k]);
        beyond = beyond || (k < N_INPUTS && !(model_lows[k] <= s->held[k] && s->held[k] <= model_highs[k]));
    }
    for (k = 0; k < (N_INPUTS + 1) * ORDERS; k++) {
        bad = bad || !isfinite(d[k]);
    }
    for (k = 0; k < N_NUMBERS; k++) {
        bad = bad || !isfinite(s->numbers[k]);
    }
    return bad ? "it holds values that are no numbers" : beyond ? "it holds values beyond their bounds" : NULL;
}

/* Everything is checked before anything is changed, so that a damaged state changes nothing. */
static Status restore(Instance *I, const Saved *s) {
    int fault = PY_NO_FAULT;
    const char *reason = flaw(s);
    if (reason) {
        return refuse(I, "the state cannot be restored: %s", reason);
    }
    if (s->mode > INSTANTIATED && load_tables(I) != STATUS_OK) {
        return STATUS_ERROR;
    }
    I->mode = s->mode;
    I->failed = s->failed != 0;
    I->begun = s->begun != 0;
    I->slopes = s->slopes != 0;
    I->time = s->time;
    I->step = s->step;
    I->motion = s->motion;
    I->begun_at = s->begun_at;
    I->samples = s->samples;
    memcpy(I->held, s->held, sizeof s->held);
    memcpy(I->values, s->values, sizeof s->values);
    memcpy(I->derivatives, s->derivatives, sizeof s->derivatives);
    model_load(&I->model, s->numbers);
    model_link(&I->model);
    model_parameters(&I->model, I->values + N_INPUTS + N_OUTPUTS);
    if (I->mode >= RUNNING) {
        model_coefficients(&I->model, I->step, &fault);
    }
    return fault ? refuse_fault(I, "the state cannot be restored: its step size", fault) : STATUS_OK;
}

/* States as FMI hands them out; only here is memory taken after initialisation, and given back by free_state */

static Status take_state(Instance *I, void **state) {
    if (!*state && !(*state = malloc(sizeof(Saved)))) {
        return refuse(I, "there is not enough memory for a state");
    }
    save(I, (Saved *)*state);
    return STATUS_OK;
}

static Status put_state(Instance *I, const void *state) {
    return state ? restore(I, (const Saved *)state) : refuse(I, "the state cannot be restored: there is none");
}

static void free_state(void **state) {
    if (state) {
        free(*state);
        *state = NULL;
    }
}

static Status state_to_bytes(Instance *I, const void *state, void *bytes, size_t size) {
    if (!state || size < sizeof(Saved)) {
        return refuse(I, "a state needs %lu bytes, not %lu", (unsigned long)sizeof(Saved), (unsigned long)size);
    }
    memcpy(bytes, state, sizeof(Saved));
    return STATUS_OK;
}

static Status state_from_bytes(Instance *I, const void *bytes, size_t size, void **state) {
    if (size != sizeof(Saved)) {
        return refuse(I, "the state cannot be restored: it was not saved by %s %s: it has %lu bytes, not %lu", MODEL_NAME,
                      MODEL_GUID, (unsigned long)size, (unsigned long)sizeof(Saved));
    }
    if (!*state && !(*state = malloc(sizeof(Saved)))) {
        return refuse(I, "there is not enough memory for a state");
    }
    memcpy(*state, bytes, sizeof(Saved));
    return STATUS_OK;
}

#endif
