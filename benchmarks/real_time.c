/* A plain-C host with a fixed-rate loop, for Linux: real_time LIBRARY RESOURCES GUID INPUT OUTPUT STEPS PERIOD

   Loads a native FMU of FMI 2.0, and at each period [ns] sets its input (by value reference), makes a step of 1 ms and reads its
   output: what a controller or a hardware-in-the-loop rig does. PERIOD 0 steps as fast as it can. Prints one line, each
   number after its name: times in ns of set + step + get (half, 99.9 % and most of all steps), by how much wake-ups were late, periods
   that were missed, and what happened while it stepped: allocations, page faults, times that the kernel took the processor away.

   The loop lies between two calls of getppid(), which mark its place in the output of strace. */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <math.h>
#include <sched.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/mman.h>
#include <sys/resource.h>
#include <time.h>
#include <unistd.h>

/* Every allocation of the process passes here, those of the FMU's library included. */
extern void *__libc_malloc(size_t), *__libc_calloc(size_t, size_t), *__libc_realloc(void *, size_t);
extern void __libc_free(void *);
static long allocations;
void *malloc(size_t n) { allocations++; return __libc_malloc(n); }
void *calloc(size_t n, size_t size) { allocations++; return __libc_calloc(n, size); }
void *realloc(void *p, size_t n) { allocations++; return __libc_realloc(p, n); }
void free(void *p) { allocations++; __libc_free(p); }

#include "fmi2_callbacks.h"

static double now(void)
{
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return 1e9 * (double)t.tv_sec + (double)t.tv_nsec;
}

static int ascending(const void *a, const void *b)
{
    double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

static double part(const double *sorted, long n, double p) { return sorted[(long)(p * (double)(n - 1))]; }

int main(int count, char **words)
{
    if (count != 8) { fputs("real_time LIBRARY RESOURCES GUID INPUT OUTPUT STEPS PERIOD\n", stderr); return 1; }
    unsigned input = (unsigned)atoi(words[4]), output = (unsigned)atoi(words[5]);
    long steps = atol(words[6]), period = atol(words[7]), missed = 0;
    void *library = dlopen(words[1], RTLD_NOW | RTLD_LOCAL);
    if (!library) { fprintf(stderr, "%s\n", dlerror()); return 2; }
    void *(*instantiate)(const char *, int, const char *, const char *, const Callbacks *, int, int) = dlsym(library, "fmi2Instantiate");
    int (*setup)(void *, int, double, double, int, double) = dlsym(library, "fmi2SetupExperiment");
    int (*enter)(void *) = dlsym(library, "fmi2EnterInitializationMode");
    int (*leave)(void *) = dlsym(library, "fmi2ExitInitializationMode");
    int (*step)(void *, double, double, int) = dlsym(library, "fmi2DoStep");
    int (*set)(void *, const unsigned *, size_t, const double *) = dlsym(library, "fmi2SetReal");
    int (*get)(void *, const unsigned *, size_t, double *) = dlsym(library, "fmi2GetReal");
    void (*release)(void *) = dlsym(library, "fmi2FreeInstance");
    void *fmu = instantiate("crane", 1, words[3], words[2], &callbacks, 0, 0);
    if (!fmu || setup(fmu, 0, 0.0, 0.0, 0, 0.0) > 1 || enter(fmu) > 1 || leave(fmu) > 1) return 3;

    double *taken = calloc((size_t)steps, sizeof *taken), *late = calloc((size_t)steps, sizeof *late);
    double *commands = calloc((size_t)steps, sizeof *commands), value = 0.0;
    if (!taken || !late || !commands) return 3;
    for (long k = 0; k < steps; k++) {
        taken[k] = late[k] = 1.0; /* their pages are there */
        commands[k] = 0.8 * sin(2e-3 * (double)k) + ((k / 700) % 2 ? 0.15 : -0.15);
    }
    struct sched_param most = {.sched_priority = 80};
    int first_in_line = sched_setscheduler(0, SCHED_FIFO, &most) == 0;
    int locked = mlockall(MCL_CURRENT | MCL_FUTURE) == 0;
    struct rusage before, after;
    struct timespec next;
    int bad = 0;
    getrusage(RUSAGE_SELF, &before);
    long allocated = allocations;
    clock_gettime(CLOCK_MONOTONIC, &next);
    getppid();
    for (long k = 0; k < steps; k++) {
        if (period) {
            next.tv_nsec += period;
            while (next.tv_nsec >= 1000000000L) { next.tv_nsec -= 1000000000L; next.tv_sec++; }
            clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &next, NULL);
        }
        double began = now();
        bad |= set(fmu, &input, 1, &commands[k]) | step(fmu, (double)k * 1e-3, 1e-3, 1) | get(fmu, &output, 1, &value);
        double ended = now();
        taken[k] = ended - began;
        if (period) {
            late[k] = began - (1e9 * (double)next.tv_sec + (double)next.tv_nsec);
            missed += ended > 1e9 * (double)next.tv_sec + (double)next.tv_nsec + (double)period;
        }
    }
    getppid();
    allocated = allocations - allocated;
    getrusage(RUSAGE_SELF, &after);
    if (bad > 1) { fputs("a call failed\n", stderr); return 4; }
    qsort(taken, (size_t)steps, sizeof *taken, ascending);
    qsort(late, (size_t)steps, sizeof *late, ascending);
    printf("output %.17g half %.0f p999 %.0f most %.0f late_half %.0f late_p999 %.0f late_most %.0f missed %ld allocations %ld faults %ld "
           "preempted %ld fifo %d locked %d\n",
           value, part(taken, steps, 0.5), part(taken, steps, 0.999), taken[steps - 1], part(late, steps, 0.5), part(late, steps, 0.999),
           late[steps - 1], missed, allocated, after.ru_minflt + after.ru_majflt - before.ru_minflt - before.ru_majflt,
           after.ru_nivcsw - before.ru_nivcsw, first_in_line, locked);
    release(fmu);
    return 0;
}
