/* An FMI 2.0 slave with one output: KIND says which equation. Inputs are held over a step, which RK4 makes in four parts. */
#include <math.h>
#include <string.h>

#include "slave.h"

enum { LAG, SECOND, SATURATING, DAMPED, SUM, STIFFENING };
enum { Y, U, V, K, T, W, ZETA, C, COUNT };

typedef struct { double r[COUNT]; double x[2]; } Part;

static void rate(const Part *p, const double *x, double *dx) {
    const double *r = p->r;
    switch (KIND) {
    case LAG: dx[0] = (r[K] * r[U] - x[0]) / r[T]; break;
    case SECOND: dx[0] = x[1]; dx[1] = r[W] * r[W] * (r[K] * r[U] - x[0]) - 2 * r[ZETA] * r[W] * x[1]; break;
    case SATURATING: dx[0] = (r[K] * tanh(r[U] / r[C]) - x[0]) / r[T]; break;
    case DAMPED: dx[0] = (r[K] * r[U] - x[0] - r[C] * x[0] * x[0] * x[0]) / r[T]; break;
    case SUM: dx[0] = (r[K] * r[U] + r[C] * r[V] - x[0]) / r[T]; break;
    case STIFFENING:
        dx[0] = x[1];
        dx[1] = r[W] * r[W] * (r[K] * r[U] - x[0] - r[C] * x[0] * x[0] * x[0]) - 2 * r[ZETA] * r[W] * x[1];
    }
}

static void start(Part *p) { memset(p, 0, sizeof *p); p->r[K] = p->r[T] = p->r[W] = p->r[C] = 1; p->r[ZETA] = 0.5; }

Component fmi2Instantiate(const char *n, int t, const char *g, const char *r, const void *c, int v, int l) {
    Part *p = malloc(sizeof *p);
    start(p);
    return p;
}
Status fmi2Reset(Component c) { start(c); return 0; }
Status fmi2GetReal(Component c, const Reference r[], size_t n, double v[]) {
    for (size_t i = 0; i < n; i++) v[i] = r[i] == Y ? ((Part *)c)->x[0] : ((Part *)c)->r[r[i]];
    return 0;
}
Status fmi2SetReal(Component c, const Reference r[], size_t n, const double v[]) {
    for (size_t i = 0; i < n; i++) if (r[i] < COUNT) ((Part *)c)->r[r[i]] = v[i];
    return 0;
}
Status fmi2DoStep(Component c, double t, double step, int f) {
    Part *p = c;
    double h = step / 4;
    for (int i = 0; i < 4; i++) {
        double k[4][2] = {{0}}, x[2];
        for (int s = 0; s < 4; s++) {
            double a = s == 0 ? 0 : s == 3 ? h : h / 2;
            for (int j = 0; j < 2; j++) x[j] = p->x[j] + (s ? a * k[s - 1][j] : 0);
            rate(p, x, k[s]);
        }
        for (int j = 0; j < 2; j++) p->x[j] += h / 6 * (k[0][j] + 2 * k[1][j] + 2 * k[2][j] + k[3][j]);
    }
    return 0;
}
