/* The end of an S-function, where Simulink finds its functions; here a test does, by ctypes. */

static SimStruct host;
static double host_inputs[MOST];

void host_begin(const char *path, double start) {
    int k;
    memset(&host, 0, sizeof host);
    host.path = path;
    host.start = start;
    for (k = 0; k < MOST; k++) {
        host.inputs[k] = &host_inputs[k];
    }
}

void host_give(const double *values, int count, const char *text) {
    mxArray *given = &host.given[host.n_given++];
    given->values = values;
    given->count = (size_t)count;
    given->text = text;
}

/* Step size, or -1 where the block would not be drawn. */
double host_size(int *n_inputs, int *n_outputs) {
    int k;
    mdlInitializeSizes(&host);
    if (host.n_asked != host.n_given || host.n_work != 1 || host.sampled != 1 || !host.exception_free) {
        return -1.0;
    }
    for (k = 0; k < host.n_inputs; k++) {
        if (host.widths[0][k] != 1 || !host.direct[k]) {
            return -1.0;
        }
    }
    mdlInitializeSampleTimes(&host);
    *n_inputs = host.n_inputs;
    *n_outputs = host.n_outputs;
    return host.step;
}

const char *host_start(void) {
    mdlStart(&host);
    return host.error;
}

/* As Simulink does, which may ask for the outputs of one time again. */
const char *host_outputs(double now, const double *inputs, double *outputs) {
    int again;
    host.now = now;
    memcpy(host_inputs, inputs, (size_t)host.n_inputs * sizeof *inputs);
    for (again = 0; again < 2; again++) {
        mdlOutputs(&host, 0);
    }
    memcpy(outputs, host.outputs, (size_t)host.n_outputs * sizeof *outputs);
    return host.error;
}

void host_update(const double *inputs) {
    memcpy(host_inputs, inputs, (size_t)host.n_inputs * sizeof *inputs);
    mdlUpdate(&host, 0);
}

void host_end(void) {
    mdlTerminate(&host);
}
