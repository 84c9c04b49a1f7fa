/* The life of an instance: made, initialised, run, ended, begun anew. */

#ifndef LIFE_H
#define LIFE_H

static void start_values(Instance *I) {
    I->mode = INSTANTIATED;
    I->failed = I->begun = I->slopes = 0;
    I->time = 0.0;
    I->step = MODEL_STEP;
    I->motion = I->begun_at = I->samples = 0.0;
    memset(I->held, 0, sizeof I->held);
    memcpy(I->values, model_starts, sizeof I->values);
    memset(I->derivatives, 0, sizeof I->derivatives);
}

static void free_instance(Instance *I) {
    free_tables(I);
    free(I->resources);
    free(I->name);
    free(I);
}

/* A new instance, or NULL and a message. It takes `resources`, which is memory of its own, in either case. */
static Instance *new_instance(const Host *host, const char *name, const char *token, char *resources, int exchange) {
    Instance *I = NULL;
    const char *shown = name ? name : "?";
    char text[512];
    if (!token || strcmp(token, MODEL_GUID) != 0) {
        snprintf(text, sizeof text, "%.100s: the " TOKEN " %.100s is refused: this is %s %s", shown, token ? token : "(none)",
                 MODEL_NAME, MODEL_GUID);
        say(host, shown, text);
    } else if (!(I = (Instance *)calloc(1, sizeof(Instance))) || !(I->name = (char *)malloc(strlen(shown) + 1))) {
        say(host, shown, "there is not enough memory");
        free(I);
        I = NULL;
    }
    if (!I) {
        free(resources);
        return NULL;
    }
    strcpy(I->name, shown);
    I->resources = resources;
    I->host = *host;
    I->exchange = exchange;
    start_values(I);
    return I;
}

/* State, memory and outputs from start values and inputs. */
static Status begin(Instance *I) {
    int fault = PY_NO_FAULT;
    if (load_tables(I) != STATUS_OK) {
        return STATUS_ERROR;
    }
    model_link(&I->model);
    model_parameters(&I->model, I->values + N_INPUTS + N_OUTPUTS);
    I->step = MODEL_STEP;
    model_begin(&I->model, I->values, I->values + N_INPUTS, I->time, &fault);
    if (!fault) {
        model_coefficients(&I->model, I->step, &fault);
    }
    if (!fault && I->exchange) {
        model_event(&I->model, I->values, &I->motion, 1, &fault);
        begin_samples(I);
    }
    if (fault) {
        return refuse_fault(I, "initialisation", fault);
    }
    if (check_exchange(I) != STATUS_OK) {
        return STATUS_ERROR;
    }
    I->begun = 1;
    return I->failed ? STATUS_ERROR : STATUS_OK;
}

static Status start_time(Instance *I, double start) {
    char text[NUMBER_SIZE];
    if (!(-1e9 < start && start < 1e9)) {
        return refuse(I, "start time %s s is refused: it must be a number within 1e9", number(start, text));
    }
    I->time = start;
    return STATUS_OK;
}

static Status enter_initialisation(Instance *I) {
    static const char *const words[] = {"instantiated", "initialising", "running", "terminated"};
    if (I->mode != INSTANTIATED) {
        return refuse(I, FMI "EnterInitializationMode while %s; reset first", words[I->mode]);
    }
    I->mode = INITIALISING;
    return begin(I);
}

static Status exit_initialisation(Instance *I) {
    if (I->mode != INITIALISING) {
        return refuse(I, FMI "ExitInitializationMode without " FMI "EnterInitializationMode");
    }
    if (begin(I) != STATUS_OK) {
        return STATUS_ERROR;
    }
    I->mode = RUNNING;
    return STATUS_OK;
}

static Status end_run(Instance *I) {
    I->mode = TERMINATED;
    return STATUS_OK;
}

static Status reset(Instance *I) {
    start_values(I);
    return STATUS_OK;
}

#endif
