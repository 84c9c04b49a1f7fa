/* An FMI 2.0 slave with the manners of 20-sim's exporter (4.6): fmi2SetupExperiment takes the start values of the model,
   fmi2Reset leaves the clock as it is, a step of FMI is as many steps of 0.01 s as it takes for the clock to reach its end,
   and a clock that is beyond the stop time is an error. x' = u - k x by Euler. */
#include <stdlib.h>

typedef void *Component;
typedef unsigned int Reference;
typedef int Status;
typedef struct {
    double x, u, k, time, stop;
} Model;

Component fmi2Instantiate(const char *n, int t, const char *g, const char *r, const void *c, int v, int l) {
    return calloc(1, sizeof(Model));
}
void fmi2FreeInstance(Component c) { free(c); }
Status fmi2SetupExperiment(Component c, int d, double tol, double start, int s, double stop) {
    Model *m = c;
    m->k = 1.0;
    m->x = 1.0;
    m->stop = stop;
    return 0;
}
Status fmi2EnterInitializationMode(Component c) { return 0; }
Status fmi2ExitInitializationMode(Component c) { return 0; }
Status fmi2Terminate(Component c) { return 0; }
Status fmi2Reset(Component c) { return FAILING ? 3 : 0; }
static double *place(Model *m, Reference r) { return r == 0 ? &m->x : r == 1 ? &m->u : &m->k; }
Status fmi2GetReal(Component c, const Reference r[], size_t n, double v[]) {
    for (size_t i = 0; i < n; i++) v[i] = *place(c, r[i]);
    return 0;
}
Status fmi2SetReal(Component c, const Reference r[], size_t n, const double v[]) {
    for (size_t i = 0; i < n; i++) *place(c, r[i]) = v[i];
    return 0;
}
Status fmi2DoStep(Component c, double t, double h, int s) {
    Model *m = c;
    while (m->time < t + h) {
        if (m->time > m->stop) return 3;
        m->x += 0.01 * (m->u - m->k * m->x);
        m->time += 0.01;
    }
    return 0;
}

/* the rest of FMI 2.0, which nobody calls */
#define ABSENT(name) Status fmi2##name(void) { return 3; }
ABSENT(GetTypesPlatform) ABSENT(GetVersion) ABSENT(SetDebugLogging) ABSENT(GetInteger) ABSENT(GetBoolean)
ABSENT(GetString) ABSENT(SetInteger) ABSENT(SetBoolean) ABSENT(SetString) ABSENT(GetFMUstate)
ABSENT(SetFMUstate) ABSENT(FreeFMUstate) ABSENT(SerializedFMUstateSize) ABSENT(SerializeFMUstate)
ABSENT(DeSerializeFMUstate) ABSENT(GetDirectionalDerivative) ABSENT(SetRealInputDerivatives)
ABSENT(GetRealOutputDerivatives) ABSENT(CancelStep) ABSENT(GetStatus) ABSENT(GetRealStatus)
ABSENT(GetIntegerStatus) ABSENT(GetBooleanStatus) ABSENT(GetStringStatus)
