/* An FMI 2.0 slave that does harm in the step that begins at t = 0.5 s, or where MISCHIEF says. y = t at the step's end. */
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

typedef void *Component;
typedef unsigned int Reference;
typedef int Status;
typedef void (*Logger)(void *, const char *, Status, const char *, const char *, ...);
typedef struct {
    Logger logger;
    void *(*allocate)(size_t, size_t);
    void (*release)(void *);
    void *finished;
    void *environment;
} Callbacks;

enum { NONE, EXIT, ABORT, SEGV, BUS, LOOP, HOG, NEGATIVE, UNKNOWN, AT_LOAD, AT_INSTANTIATE, AT_INITIALISE, AT_END, SAYS, CHATTER, SHOUTS, CLOSES, FORKS };

static double y, u;
static const Callbacks *calls;

__attribute__((constructor)) static void at_load(void) { if (MISCHIEF == AT_LOAD) _exit(0); }

Component fmi2Instantiate(const char *n, int t, const char *g, const char *r, const Callbacks *c, int v, int l) {
    calls = c;
    if (MISCHIEF == AT_INSTANTIATE) exit(0);
    return &y;
}
void fmi2FreeInstance(Component c) {}
Status fmi2SetupExperiment(Component c, int d, double tol, double start, int s, double stop) { y = start; return 0; }
Status fmi2EnterInitializationMode(Component c) { if (MISCHIEF == AT_INITIALISE) abort(); return 0; }
Status fmi2ExitInitializationMode(Component c) { return 0; }
Status fmi2Terminate(Component c) { if (MISCHIEF == AT_END) exit(0); return 0; }
Status fmi2Reset(Component c) { y = 0.0; return 0; }
Status fmi2GetReal(Component c, const Reference r[], size_t n, double v[]) {
    for (size_t i = 0; i < n; i++) v[i] = r[i] ? u : y;
    return 0;
}
Status fmi2SetReal(Component c, const Reference r[], size_t n, const double v[]) {
    for (size_t i = 0; i < n; i++) if (r[i]) u = v[i];
    return 0;
}

static Status harm(void) {
    volatile char *p = 0;
    switch (MISCHIEF) {
    case EXIT: exit(0);
    case SAYS:
        calls->logger(calls->environment, "bad", 3, "error", "no licence for %d seats", 3);
        exit(7);
    case ABORT: abort();
    case SEGV: *p = 1; break;
    case BUS: raise(SIGBUS); break;
    case LOOP: for (;;) p = (volatile char *)&p;
    case HOG:
        for (;;) {
            char *more = malloc(1 << 22);
            if (more) memset(more, 1, 1 << 22);
        }
    case NEGATIVE: return -1;
    case UNKNOWN: return 77;
    case SHOUTS: {
        char *text = malloc(1 << 20);
        memset(text, 'x', 1 << 20);
        memcpy(text, "\033[2J", 4);
        text[(1 << 20) - 1] = 0;
        calls->logger(calls->environment, "bad", 3, "error", text);
        return 3;
    }
    case CLOSES: for (int i = 0; i < 1024; i++) close(i); break;
    case FORKS: fork(); break;
    case CHATTER: printf("{\"piece\": 0, \"count\": 1}\n"); fflush(stdout); break;
    }
    return 0;
}

Status fmi2DoStep(Component c, double t, double h, int s) {
    if (t > 0.4999 && t < 0.5001) {
        Status status = harm();
        if (status) return status;
    }
    y = t + h;
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
