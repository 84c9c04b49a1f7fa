/* What is drawn by a seed for any calls in any order: right three times in four. After fmu.c, whose numbers it needs. */

#define SLAVES 6
#define STATES 8
#define MOST 12

static unsigned long long seed;

/* Next of 2^32 numbers: Knuth's generator, upper half. */
static unsigned drawn(void) {
    seed = seed * 6364136223846793005ull + 1442695040888963407ull;
    return (unsigned)(seed >> 32);
}

static unsigned below(unsigned n) { return drawn() % n; }

static double any_number(void) {
    const double odd[] = {0.0, -0.0, 1.0, -1.0, 1e-300, 1e300, -1e300, NAN, INFINITY, -INFINITY, 1e-3, 4e9};
    return below(3) ? (drawn() / 4294967296.0 - 0.5) * 2.0 : odd[below(sizeof odd / sizeof *odd)];
}

static Reference reference(void) {
    if (below(4)) {
        return N_VARIABLES ? below(N_VARIABLES) : 0;
    }
    return below(2) ? N_VARIABLES + below(2 * N_STATES + 3) : drawn();
}
