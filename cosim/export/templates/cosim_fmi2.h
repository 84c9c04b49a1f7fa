/* Runs an unpacked FMI 2.0 co-simulation FMU from Modelica. Included by the package beside it; needs nothing but libc.

   A step to a time that was already reached only reads outputs again, so a tool may evaluate an event more than once. */
#ifndef COSIM_FMI2_H
#define COSIM_FMI2_H

#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "ModelicaUtilities.h"

#ifdef _WIN32
#include <windows.h>
#define COSIM_PLATFORM "win64"
#define COSIM_SUFFIX ".dll"
#define COSIM_SCHEME "file:///"
#define COSIM_OPEN(path) ((void *)LoadLibraryA(path))
#define COSIM_SYMBOL(library, name) ((void *)GetProcAddress((HMODULE)(library), name))
#define COSIM_REASON() "it or a library that it needs, such as python3.dll, is not found on the PATH"
#else
#include <dlfcn.h>
#define COSIM_PLATFORM "linux64"
#define COSIM_SUFFIX ".so"
#define COSIM_SCHEME "file://"
#define COSIM_OPEN(path) dlopen(path, RTLD_NOW | RTLD_LOCAL)
#define COSIM_SYMBOL(library, name) dlsym(library, name)
#define COSIM_REASON() dlerror()
#endif

typedef struct {
    void (*logger)(void *, const char *, int, const char *, const char *, ...);
    void *(*allocate)(size_t, size_t);
    void (*release)(void *);
    void (*finished)(void *, int);
    void *environment;
} CosimCallbacks;

typedef struct {
    char name[256];
    char message[1024]; /* the first complaint that the FMU logged, or else its last message */
    int complained;
    void *slave;
    int started, running;
    double origin; /* start of the experiment */
    double count; /* steps made so far */
    CosimCallbacks callbacks;
    int (*setup)(void *, int, double, double, int, double);
    int (*enter)(void *);
    int (*leave)(void *);
    int (*step)(void *, double, double, int);
    int (*terminate)(void *);
    void (*release)(void *);
    int (*set_real)(void *, const unsigned int *, size_t, const double *);
    int (*get_real)(void *, const unsigned int *, size_t, double *);
    int (*set_integer)(void *, const unsigned int *, size_t, const int *);
    int (*set_boolean)(void *, const unsigned int *, size_t, const int *);
} CosimFmu;

static void cosim_log(void *environment, const char *name, int status, const char *category, const char *message, ...)
{
    CosimFmu *fmu = (CosimFmu *)environment;
    va_list rest;
    (void)name; (void)category;
    if (fmu->complained) return;
    fmu->complained = status > 0;
    va_start(rest, message);
    vsnprintf(fmu->message, sizeof fmu->message, message, rest);
    va_end(rest);
}

static void cosim_check(CosimFmu *fmu, int status, const char *call, double time)
{
    if (status > 1)
        ModelicaFormatError("FMU '%s': %s failed at t = %.9g s (status %d). %s", fmu->name, call, time, status, fmu->message);
}

static void *cosim_symbol(CosimFmu *fmu, void *library, const char *name)
{
    void *found = COSIM_SYMBOL(library, name);
    if (!found) ModelicaFormatError("FMU '%s' has no function %s: it is no FMI 2.0 co-simulation FMU", fmu->name, name);
    return found;
}

/* folder: of the unpacked FMU; identifier, guid: of its model description; name: of the instance */
static void *cosim_fmu_open(const char *folder, const char *identifier, const char *guid, const char *name)
{
    CosimFmu *fmu = (CosimFmu *)calloc(1, sizeof(CosimFmu));
    size_t length = strlen(folder) + strlen(identifier) + 64;
    char *path = (char *)malloc(length);
    void *library;
    void *(*instantiate)(const char *, int, const char *, const char *, const CosimCallbacks *, int, int);
    if (!fmu || !path) ModelicaError("no memory for an FMU");
    snprintf(fmu->name, sizeof fmu->name, "%s", name);
    snprintf(path, length, "%s/binaries/" COSIM_PLATFORM "/%s" COSIM_SUFFIX, folder, identifier);
    library = COSIM_OPEN(path);
    if (!library) {
        const char *reason = COSIM_REASON();
        const char *python = reason && strstr(reason, "_Py") ? ". It runs Python: start this tool with LD_PRELOAD=libpython3.so of your Python" : "";
        ModelicaFormatError("FMU '%s': %s cannot be loaded: %s%s", fmu->name, path, reason ? reason : "unknown reason", python);
    }
    *(void **)&instantiate = cosim_symbol(fmu, library, "fmi2Instantiate");
    *(void **)&fmu->setup = cosim_symbol(fmu, library, "fmi2SetupExperiment");
    *(void **)&fmu->enter = cosim_symbol(fmu, library, "fmi2EnterInitializationMode");
    *(void **)&fmu->leave = cosim_symbol(fmu, library, "fmi2ExitInitializationMode");
    *(void **)&fmu->step = cosim_symbol(fmu, library, "fmi2DoStep");
    *(void **)&fmu->terminate = cosim_symbol(fmu, library, "fmi2Terminate");
    *(void **)&fmu->release = cosim_symbol(fmu, library, "fmi2FreeInstance");
    *(void **)&fmu->set_real = cosim_symbol(fmu, library, "fmi2SetReal");
    *(void **)&fmu->get_real = cosim_symbol(fmu, library, "fmi2GetReal");
    *(void **)&fmu->set_integer = cosim_symbol(fmu, library, "fmi2SetInteger");
    *(void **)&fmu->set_boolean = cosim_symbol(fmu, library, "fmi2SetBoolean");
    fmu->callbacks.logger = cosim_log;
    fmu->callbacks.allocate = calloc;
    fmu->callbacks.release = free;
    fmu->callbacks.environment = fmu;
    snprintf(path, length, COSIM_SCHEME "%s/resources", folder);
    fmu->slave = instantiate(name, 1, guid, path, &fmu->callbacks, 0, 1);
    free(path);
    if (!fmu->slave) ModelicaFormatError("FMU '%s' cannot be instantiated. %s", fmu->name, fmu->message);
    return fmu;
}

/* The library stays loaded: unloading one that runs Python crashes the process. */
static void cosim_fmu_close(void *object)
{
    CosimFmu *fmu = (CosimFmu *)object;
    if (!fmu) return;
    if (fmu->running) fmu->terminate(fmu->slave);
    if (fmu->slave) fmu->release(fmu->slave);
    free(fmu);
}

/* Set parameters and enter initialisation mode, once; answers 1. */
static int cosim_fmu_start(void *object, double time, const int *reals, size_t n, const double *real_values, size_t n1,
    const int *integers, size_t m, const int *integer_values, size_t m1,
    const int *booleans, size_t b, const int *boolean_values, size_t b1)
{
    CosimFmu *fmu = (CosimFmu *)object;
    (void)n1; (void)m1; (void)b1;
    if (fmu->started) return 1;
    if (n) cosim_check(fmu, fmu->set_real(fmu->slave, (const unsigned int *)reals, n, real_values), "fmi2SetReal", time);
    if (m) cosim_check(fmu, fmu->set_integer(fmu->slave, (const unsigned int *)integers, m, integer_values), "fmi2SetInteger", time);
    if (b) cosim_check(fmu, fmu->set_boolean(fmu->slave, (const unsigned int *)booleans, b, boolean_values), "fmi2SetBoolean", time);
    cosim_check(fmu, fmu->setup(fmu->slave, 0, 0.0, time, 0, 0.0), "fmi2SetupExperiment", time);
    cosim_check(fmu, fmu->enter(fmu->slave), "fmi2EnterInitializationMode", time);
    fmu->started = 1;
    fmu->origin = time;
    return 1;
}

static void cosim_exchange(CosimFmu *fmu, double time, const int *inputs, size_t n, const double *u)
{
    if (n) cosim_check(fmu, fmu->set_real(fmu->slave, (const unsigned int *)inputs, n, u), "fmi2SetReal", time);
}

/* Outputs in initialisation mode, for the inputs that act on them directly. */
static void cosim_fmu_initial(void *object, int started, const int *inputs, size_t n, const double *u, size_t n1,
    const int *outputs, size_t m, double *y, size_t m1)
{
    CosimFmu *fmu = (CosimFmu *)object;
    (void)started; (void)n1; (void)m1;
    if (!fmu->running) cosim_exchange(fmu, fmu->origin, inputs, n, u);
    cosim_check(fmu, fmu->get_real(fmu->slave, (const unsigned int *)outputs, m, y), "fmi2GetReal", fmu->origin);
}

/* Leave initialisation mode with all inputs as they are at the start, once; answers 1. The outputs only order the calls. */
static int cosim_fmu_leave(void *object, const int *inputs, size_t n, const double *u, size_t n1, const double *y, size_t m)
{
    CosimFmu *fmu = (CosimFmu *)object;
    (void)n1; (void)y; (void)m;
    if (fmu->running) return 1;
    cosim_exchange(fmu, fmu->origin, inputs, n, u);
    cosim_check(fmu, fmu->leave(fmu->slave), "fmi2ExitInitializationMode", fmu->origin);
    fmu->running = 1;
    return 1;
}

/* Outputs at `time`, after a step of size h that ends there. */
static void cosim_fmu_step(void *object, double time, double h, const int *inputs, size_t n, const double *u, size_t n1,
    const int *outputs, size_t m, double *y, size_t m1)
{
    CosimFmu *fmu = (CosimFmu *)object;
    double begin = fmu->origin + fmu->count * h;
    (void)n1; (void)m1;
    if (!fmu->running) ModelicaFormatError("FMU '%s' is stepped before it is initialised", fmu->name);
    if (time > begin + 0.5 * h) {
        cosim_exchange(fmu, begin, inputs, n, u);
        cosim_check(fmu, fmu->step(fmu->slave, begin, h, 1), "fmi2DoStep", begin);
        fmu->count += 1.0;
    }
    cosim_check(fmu, fmu->get_real(fmu->slave, (const unsigned int *)outputs, m, y), "fmi2GetReal", time);
}

#endif
