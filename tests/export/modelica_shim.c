/* Makes the functions of the exported header callable from Python. */
#include "cosim_fmi2.h"

void *shim_open(const char *folder, const char *identifier, const char *guid, const char *name) { return cosim_fmu_open(folder, identifier, guid, name); }
void shim_close(void *fmu) { cosim_fmu_close(fmu); }
int shim_start(void *fmu, double time, const int *r, size_t n, const double *rv, const int *i, size_t m, const int *iv)
{
    return cosim_fmu_start(fmu, time, r, n, rv, n, i, m, iv, m, NULL, 0, NULL, 0);
}
void shim_initial(void *fmu, const int *in, size_t n, const double *u, const int *out, size_t m, double *y) { cosim_fmu_initial(fmu, 1, in, n, u, n, out, m, y, m); }
void shim_leave(void *fmu, const int *in, size_t n, const double *u) { cosim_fmu_leave(fmu, in, n, u, n, NULL, 0); }
void shim_step(void *fmu, double time, double h, const int *in, size_t n, const double *u, const int *out, size_t m, double *y) { cosim_fmu_step(fmu, time, h, in, n, u, n, out, m, y, m); }
