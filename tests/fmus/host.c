/* A host that is not Python: loads an FMU, runs it three times with resets, and ends as it is told.

   host LIBRARY RESOURCES GUID HOW: "f" in HOW frees the instance, "c" closes the library. */
#include <dlfcn.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "../../benchmarks/fmi2_callbacks.h"

int main(int count, char **words)
{
    void *library = count == 5 ? dlopen(words[1], RTLD_NOW | RTLD_LOCAL) : NULL;
    if (!library) { fputs(dlerror(), stderr); return 2; }
    void *(*instantiate)(const char *, int, const char *, const char *, const Callbacks *, int, int) = dlsym(library, "fmi2Instantiate");
    int (*setup)(void *, int, double, double, int, double) = dlsym(library, "fmi2SetupExperiment");
    int (*enter)(void *) = dlsym(library, "fmi2EnterInitializationMode");
    int (*leave)(void *) = dlsym(library, "fmi2ExitInitializationMode");
    int (*step)(void *, double, double, int) = dlsym(library, "fmi2DoStep");
    int (*reset)(void *) = dlsym(library, "fmi2Reset");
    void (*free_instance)(void *) = dlsym(library, "fmi2FreeInstance");
    void *slave = instantiate("slave", 1, words[3], words[2], &callbacks, 0, 1);
    if (!slave) return 3;
    int status = 0;
    for (int run = 0; run < 3; run++) {
        status |= setup(slave, 0, 0.0, 0.0, 0, 0.0) | enter(slave) | leave(slave);
        for (int k = 0; k < 100; k++) status |= step(slave, k * 1e-3, 1e-3, 1);
        status |= reset(slave);
    }
    if (strchr(words[4], 'f')) free_instance(slave);
    if (strchr(words[4], 'c')) dlclose(library);
    puts("done");
    return status;
}
