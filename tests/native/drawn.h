/* What is drawn by a seed for any calls in any order: right three times in four. After fmu.c, whose numbers it needs.

   With FUZZED the seed of each call is four bytes of an input of libFuzzer, which looks for calls that reach new code. */

#define SLAVES 6
#define STATES 8
#define MOST 12
#define MOST_CALLS 2000 /* of one input of libFuzzer */

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

#ifdef FUZZED
#include <stdint.h>

static const uint8_t *input;
static size_t left;

/* Whether there is another call, and its seed. */
static int another(unsigned long calls, unsigned long most) {
    uint32_t next;
    if (calls >= most || left < sizeof next) {
        return 0;
    }
    memcpy(&next, input, sizeof next);
    input += sizeof next;
    left -= sizeof next;
    seed = next;
    drawn(); /* the first draw of neighbouring seeds is nearly the same */
    return 1;
}
#else
static int another(unsigned long calls, unsigned long most) { return calls < most; }
#endif

/* Makes calls, at most so many; the words are RESOURCES and what tells the FMU from others. Returns how many there were. */
static unsigned long sequence(const char *resources, const char *token, unsigned long most);

#ifdef FUZZED
int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    input = data;
    left = size;
    sequence(getenv("FMU_RESOURCES"), getenv("FMU_TOKEN"), MOST_CALLS);
    return 0;
}
#else
int main(int count, char **words) {
    if (count != 5) {
        return 2;
    }
    seed = strtoull(words[3], NULL, 10);
    printf("%lu\n", sequence(words[1], words[2], strtoul(words[4], NULL, 10)));
    return 0;
}
#endif
