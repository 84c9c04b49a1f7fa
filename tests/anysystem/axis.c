/* An FMI 2.0 slave of a cylinder's axis: dead zone of its valve, a speed each way, a lag of it, and an end of the travel. */
#include "slave.h"

enum { Y, U, NEUTRAL, DZ_UP, DZ_DOWN, K_UP, K_DOWN, LAG, START, END, COUNT };

typedef struct { double r[COUNT], v; } Part;

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
    for (size_t i = 0; i < n; i++) {
        ((Part *)c)->r[r[i]] = v[i];
        if (r[i] == START) ((Part *)c)->r[Y] = v[i];
    }
    return 0;
}
Status fmi2DoStep(Component c, double t, double step, int f) {
    Part *p = c;
    double h = step / 100, u = p->r[U] - p->r[NEUTRAL], goal = 0;
    if (u > p->r[DZ_UP]) goal = p->r[K_UP] * (u - p->r[DZ_UP]);
    if (u < -p->r[DZ_DOWN]) goal = p->r[K_DOWN] * (u + p->r[DZ_DOWN]);
    for (int i = 0; i < 100; i++) {
        p->v += h * (goal - p->v) / p->r[LAG];
        p->r[Y] += h * p->v;
        if (p->r[Y] > p->r[END]) p->r[Y] = p->r[END];
    }
    return 0;
}
