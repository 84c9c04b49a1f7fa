/* An FMI 2.0 slave of ten damped oscillators side by side: y = sum of x_k, x'' = w^2 (g u - x) - 2 z w x'. */
#include "slave.h"

#define SECTIONS 10
enum { Y, U, FIRST }; /* then g, w, z of each section, which begin as STARTS says */

typedef struct { double r[FIRST + 3 * SECTIONS]; double x[SECTIONS], v[SECTIONS]; } Part;

Status fmi2Reset(Component c) {
    *(Part *)c = (Part){{0, 0, STARTS}};
    return 0;
}
Component fmi2Instantiate(const char *n, int t, const char *g, const char *r, const void *c, int v, int l) {
    Part *p = calloc(1, sizeof *p);
    fmi2Reset(p);
    return p;
}
Status fmi2GetReal(Component c, const Reference r[], size_t n, double v[]) {
    for (size_t i = 0; i < n; i++) v[i] = ((Part *)c)->r[r[i]];
    return 0;
}
Status fmi2SetReal(Component c, const Reference r[], size_t n, const double v[]) {
    for (size_t i = 0; i < n; i++) ((Part *)c)->r[r[i]] = v[i];
    return 0;
}
Status fmi2DoStep(Component c, double t, double step, int f) {
    Part *p = c;
    double h = step / 20, sum = 0;
    for (int k = 0; k < SECTIONS; k++) {
        const double *q = p->r + FIRST + 3 * k;
        for (int i = 0; i < 20; i++) { /* semi-implicit Euler */
            p->v[k] += h * (q[1] * q[1] * (q[0] * p->r[U] - p->x[k]) - 2 * q[2] * q[1] * p->v[k]);
            p->x[k] += h * p->v[k];
        }
        sum += p->x[k];
    }
    p->r[Y] = sum;
    return 0;
}
