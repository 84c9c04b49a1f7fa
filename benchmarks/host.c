/* A co-simulation master in plain C for Linux and Windows, without Python and without libraries: host PLAN STEPS STEP_SIZE

   The plan is text, one item a line, numbers in SI units:
     component NAME LIBRARY RESOURCES GUID     in stepping order
     real REFERENCE VALUE | integer REFERENCE VALUE     start values of the component before
     wire SOURCE REFERENCE TARGET REFERENCE LATE        components by number; LATE: the value at the start of the step
     output COMPONENT REFERENCE
   Writes one row of outputs for the start and one for each step, with all digits.
   With -DFMI=3 its FMUs are of FMI 3.0 (RESOURCES a path with its last slash, GUID the instantiation token), else of 2.0. */
#ifdef _WIN32
#include <windows.h>
#define symbol(library, name) ((void *)(size_t)GetProcAddress(library, name))
#else
#include <dlfcn.h>
#define symbol(library, name) dlsym(library, name)
#endif
#include <stdarg.h>
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define MOST 64

#ifndef FMI
#define FMI 2
#endif

typedef struct {
    void *slave;
    int (*leave)(void *);
    int (*terminate)(void *);
    void (*release)(void *);
#if FMI == 3
    int (*enter)(void *, bool, double, double, bool, double);
    int (*step)(void *, double, double, bool, bool *, bool *, bool *, double *);
    int (*set_real)(void *, const unsigned *, size_t, const double *, size_t);
    int (*get_real)(void *, const unsigned *, size_t, double *, size_t);
    int (*set_integer)(void *, const unsigned *, size_t, const int *, size_t);
#else
    int (*setup)(void *, int, double, double, int, double);
    int (*enter)(void *);
    int (*step)(void *, double, double, int);
    int (*set_real)(void *, const unsigned *, size_t, const double *);
    int (*get_real)(void *, const unsigned *, size_t, double *);
    int (*set_integer)(void *, const unsigned *, size_t, const int *);
#endif
} Fmu;

typedef struct {
    int source, target, late;
    unsigned from, to;
    double value;
} Wire;

static Fmu fmus[MOST];
static Wire wires[MOST], outputs[MOST];
static int n_fmus, n_wires, n_outputs;

static void check(int status, const char *what)
{
    if (status > 1) { fprintf(stderr, "%s answered %d\n", what, status); exit(4); }
}

static void *opened(const char *path)
{
#ifdef _WIN32
    void *library = LoadLibraryA(path);
    if (!library) { fprintf(stderr, "%s cannot be loaded: error %lu\n", path, GetLastError()); exit(2); }
#else
    void *library = dlopen(path, RTLD_NOW | RTLD_LOCAL);
    if (!library) { fprintf(stderr, "%s\n", dlerror()); exit(2); }
#endif
    return library;
}

#if FMI == 3
static void logger(void *environment, int status, const char *category, const char *message)
{
    (void)environment; (void)category;
    if (status != 0) fprintf(stderr, "%s\n", message);
}

static void load(Fmu *fmu, const char *name, const char *path, const char *resources, const char *token)
{
    void *library = opened(path);
    void *(*instantiate)(const char *, const char *, const char *, bool, bool, bool, bool, const unsigned *, size_t, void *,
                         void (*)(void *, int, const char *, const char *), void *) = symbol(library, "fmi3InstantiateCoSimulation");
    fmu->enter = symbol(library, "fmi3EnterInitializationMode");
    fmu->leave = symbol(library, "fmi3ExitInitializationMode");
    fmu->step = symbol(library, "fmi3DoStep");
    fmu->terminate = symbol(library, "fmi3Terminate");
    fmu->release = symbol(library, "fmi3FreeInstance");
    fmu->set_real = symbol(library, "fmi3SetFloat64");
    fmu->get_real = symbol(library, "fmi3GetFloat64");
    fmu->set_integer = symbol(library, "fmi3SetInt32");
    fmu->slave = instantiate(name, token, resources, false, true, false, false, NULL, 0, NULL, logger, NULL);
    if (!fmu->slave) { fprintf(stderr, "%s cannot be instantiated\n", name); exit(3); }
}

static void enter(const Fmu *fmu) { check(fmu->enter(fmu->slave, false, 0.0, 0.0, false, 0.0), "fmi3EnterInitializationMode"); }

static void set_real(const Fmu *fmu, unsigned reference, double value)
{
    check(fmu->set_real(fmu->slave, &reference, 1, &value, 1), "fmi3SetFloat64");
}

static void set_integer(const Fmu *fmu, unsigned reference, int value)
{
    check(fmu->set_integer(fmu->slave, &reference, 1, &value, 1), "fmi3SetInt32");
}

static double get_real(const Fmu *fmu, unsigned reference)
{
    double value;
    check(fmu->get_real(fmu->slave, &reference, 1, &value, 1), "fmi3GetFloat64");
    return value;
}

static void step(const Fmu *fmu, double time, double h)
{
    bool event, end, early;
    double last;
    check(fmu->step(fmu->slave, time, h, true, &event, &end, &early, &last), "fmi3DoStep");
    if (event || end || early) { fputs("fmi3DoStep wants more than a step\n", stderr); exit(4); }
}
#else
#include "fmi2_callbacks.h"

static void load(Fmu *fmu, const char *name, const char *path, const char *resources, const char *guid)
{
    void *library = opened(path);
    void *(*instantiate)(const char *, int, const char *, const char *, const Callbacks *, int, int) = symbol(library, "fmi2Instantiate");
    fmu->setup = symbol(library, "fmi2SetupExperiment");
    fmu->enter = symbol(library, "fmi2EnterInitializationMode");
    fmu->leave = symbol(library, "fmi2ExitInitializationMode");
    fmu->step = symbol(library, "fmi2DoStep");
    fmu->terminate = symbol(library, "fmi2Terminate");
    fmu->release = symbol(library, "fmi2FreeInstance");
    fmu->set_real = symbol(library, "fmi2SetReal");
    fmu->get_real = symbol(library, "fmi2GetReal");
    fmu->set_integer = symbol(library, "fmi2SetInteger");
    fmu->slave = instantiate(name, 1, guid, resources, &callbacks, 0, 1);
    if (!fmu->slave) { fprintf(stderr, "%s cannot be instantiated\n", name); exit(3); }
}

static void enter(const Fmu *fmu)
{
    check(fmu->setup(fmu->slave, 0, 0.0, 0.0, 0, 0.0), "fmi2SetupExperiment");
    check(fmu->enter(fmu->slave), "fmi2EnterInitializationMode");
}

static void set_real(const Fmu *fmu, unsigned reference, double value)
{
    check(fmu->set_real(fmu->slave, &reference, 1, &value), "fmi2SetReal");
}

static void set_integer(const Fmu *fmu, unsigned reference, int value)
{
    check(fmu->set_integer(fmu->slave, &reference, 1, &value), "fmi2SetInteger");
}

static double get_real(const Fmu *fmu, unsigned reference)
{
    double value;
    check(fmu->get_real(fmu->slave, &reference, 1, &value), "fmi2GetReal");
    return value;
}

static void step(const Fmu *fmu, double time, double h) { check(fmu->step(fmu->slave, time, h, 1), "fmi2DoStep"); }
#endif

static void read_plan(const char *file)
{
    char word[32], name[256], path[2048], resources[2048], guid[256];
    unsigned reference;
    double real;
    int integer;
    FILE *plan = fopen(file, "r");
    if (!plan) { perror(file); exit(1); }
    while (fscanf(plan, "%31s", word) == 1) {
        Fmu *last = &fmus[n_fmus - 1];
        if (!strcmp(word, "component") && n_fmus < MOST && fscanf(plan, "%255s %2047s %2047s %255s", name, path, resources, guid) == 4)
            load(&fmus[n_fmus++], name, path, resources, guid);
        else if (!strcmp(word, "real") && fscanf(plan, "%u %lf", &reference, &real) == 2)
            set_real(last, reference, real);
        else if (!strcmp(word, "integer") && fscanf(plan, "%u %d", &reference, &integer) == 2)
            set_integer(last, reference, integer);
        else if (!strcmp(word, "wire") && n_wires < MOST
                 && fscanf(plan, "%d %u %d %u %d", &wires[n_wires].source, &wires[n_wires].from, &wires[n_wires].target, &wires[n_wires].to, &wires[n_wires].late) == 5)
            n_wires++;
        else if (!strcmp(word, "output") && n_outputs < MOST && fscanf(plan, "%d %u", &outputs[n_outputs].source, &outputs[n_outputs].from) == 2)
            n_outputs++;
        else { fprintf(stderr, "bad plan at '%s'\n", word); exit(1); }
    }
    fclose(plan);
}

static double get(const Wire *wire) { return get_real(&fmus[wire->source], wire->from); }

/* Hand over the inputs of a component; a late wire keeps the value that was taken at the start of the step. */
static void feed(int target, int starting)
{
    for (int w = 0; w < n_wires; w++) {
        if (wires[w].target != target) continue;
        if (starting || !wires[w].late) wires[w].value = get(&wires[w]);
        set_real(&fmus[target], wires[w].to, wires[w].value);
    }
}

static void write_row(double time)
{
    printf("%.17g", time);
    for (int i = 0; i < n_outputs; i++) printf(" %.17g", get(&outputs[i]));
    putchar('\n');
}

int main(int count, char **words)
{
    if (count != 4) { fputs("host PLAN STEPS STEP_SIZE\n", stderr); return 1; }
    int steps = atoi(words[2]);
    double h = atof(words[3]);
    read_plan(words[1]);
    for (int c = 0; c < n_fmus; c++) enter(&fmus[c]);
    for (int sweep = 0; sweep < 2; sweep++)
        for (int c = 0; c < n_fmus; c++) feed(c, 1);
    for (int c = 0; c < n_fmus; c++) {
        feed(c, 1);
        check(fmus[c].leave(fmus[c].slave), "ExitInitializationMode");
    }
    write_row(0.0);
    for (int k = 0; k < steps; k++) {
        for (int w = 0; w < n_wires; w++)
            if (wires[w].late) wires[w].value = get(&wires[w]);
        for (int c = 0; c < n_fmus; c++) {
            feed(c, 0);
            step(&fmus[c], k * h, h);
        }
        write_row((k + 1) * h);
    }
    fflush(stdout);
    for (int c = 0; c < n_fmus; c++) {
        check(fmus[c].terminate(fmus[c].slave), "Terminate");
        fmus[c].release(fmus[c].slave);
    }
    return 0;
}
