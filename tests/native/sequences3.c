/* As sequences.c, with the calls of FMI 3.0: sequences3 RESOURCES TOKEN SEED CALLS. */

#include "fmu.c"

#include "drawn.h"

static void logger(fmi3InstanceEnvironment environment, fmi3Status status, fmi3String category, fmi3String message) {
    char text[4096];
    (void)environment;
    (void)status;
    (void)category;
    snprintf(text, sizeof text, "%s", message); /* read, so that a bad pointer shows */
}

static fmi3Instance any_instance(const char *folder, const char *right) {
    const fmi3String token = below(16) ? right : "{wrong}", resources = below(16) ? folder : below(2) ? "nowhere/" : NULL;
    const fmi3ValueReference r[] = {0};
    switch (below(12)) {
    case 0: return fmi3InstantiateScheduledExecution("a", token, resources, false, true, NULL, logger, NULL, NULL, NULL);
    case 1: case 2: case 3: return fmi3InstantiateModelExchange("a", token, resources, false, below(2), NULL, below(4) ? logger : NULL);
    default:
        return fmi3InstantiateCoSimulation("a", token, resources, false, below(2), !below(16), below(2), r, !below(16), NULL,
                                           below(4) ? logger : NULL, NULL);
    }
}

static unsigned long sequence(const char *resources, const char *token, unsigned long most) {
    fmi3Instance slaves[SLAVES] = {NULL};
    fmi3FMUState states[STATES] = {NULL};
    fmi3Instance owner[STATES] = {NULL}; /* a state belongs to the instance that gave it */
    fmi3Byte bytes[sizeof(Saved) + 8];
    unsigned long calls;
    size_t size;
    unsigned k;
    memset(bytes, 0, sizeof bytes);
    for (calls = 0; another(calls, most); calls++) {
        const unsigned at = below(SLAVES), s = below(STATES), n = below(MOST + 1);
        const size_t m = below(8) ? n : below(MOST + 1); /* as many values as references, most often */
        fmi3Instance c = slaves[at];
        fmi3ValueReference references[MOST], knowns[MOST];
        double reals[MOST], found[MOST], x[N_STATES + 3];
        fmi3Int32 wholes[MOST];
        fmi3Boolean truths[6];
        for (k = 0; k < MOST; k++) {
            references[k] = reference();
            knowns[k] = reference();
            reals[k] = any_number();
            wholes[k] = below(2) ? (fmi3Int32)below(5) : (fmi3Int32)drawn();
        }
        if (!c && below(8)) { /* NULL is refused by every function; most often an instance is made */
            slaves[at] = any_instance(resources, token);
            continue;
        }
        switch (below(30)) {
        case 0: fmi3EnterInitializationMode(c, below(2), reals[0], below(2) ? 0.0 : reals[1], below(2), reals[2]); break;
        case 1: case 2: case 3: case 4: fmi3EnterInitializationMode(c, false, 0.0, 0.0, false, 0.0); break;
        case 5: case 6: case 7: fmi3ExitInitializationMode(c); break;
        case 8: case 9: case 10:
            fmi3DoStep(c, below(4) ? calls * 1e-3 : reals[0], below(4) ? 1e-3 : reals[1], below(2), truths, truths + 1, truths + 2, found);
            break;
        case 11: case 12: fmi3SetFloat64(c, references, n, reals, m); break;
        case 13: fmi3GetFloat64(c, references, n, found, m); break;
        case 14: fmi3SetInt32(c, references, n, wholes, m); break;
        case 15: fmi3GetInt32(c, references, n, wholes, m); break;
        case 16: {
            fmi3Binary binaries[MOST] = {NULL};
            fmi3String texts[MOST] = {NULL};
            size_t sizes[MOST] = {0};
            fmi3Float32 singles[MOST] = {0};
            fmi3SetBinary(c, references, n, sizes, binaries, m);
            fmi3GetBinary(c, references, n, sizes, binaries, m);
            fmi3SetString(c, references, n, texts, m);
            fmi3GetString(c, references, n, texts, m);
            fmi3SetFloat32(c, references, n, singles, m);
            fmi3GetFloat32(c, references, n, singles, m);
            break;
        }
        case 17: fmi3GetDirectionalDerivative(c, references, n, knowns, m, reals, below(8) ? m : n, found, n); break;
        case 18: fmi3GetAdjointDerivative(c, references, n, knowns, m, reals, n, found, below(8) ? m : n); break;
        case 19:
            if (!states[s] || owner[s] == c) {
                fmi3GetFMUState(c, &states[s]);
                owner[s] = states[s] ? c : NULL;
            }
            break;
        case 20: fmi3SetFMUState(c, owner[s] == c ? states[s] : NULL); break;
        case 21:
            if (owner[s] == c && states[s] && !fmi3SerializedFMUStateSize(c, states[s], &size) && size <= sizeof bytes) {
                fmi3SerializeFMUState(c, states[s], bytes, below(8) ? size : below((unsigned)size));
            }
            break;
        case 22:
            if (below(2)) {
                bytes[below(sizeof bytes)] ^= (fmi3Byte)(1u << below(8));
            }
            if (!states[s] || owner[s] == c) {
                fmi3DeserializeFMUState(c, bytes, below(8) ? sizeof(Saved) : below(sizeof(Saved)), &states[s]);
                owner[s] = states[s] ? c : NULL;
            }
            break;
        case 23:
            if (owner[s] == c && c) {
                fmi3FreeFMUState(c, &states[s]);
                owner[s] = NULL;
            }
            break;
        case 24: fmi3Terminate(c); break;
        case 25: fmi3Reset(c); break;
        case 26:
            fmi3EnterConfigurationMode(c);
            fmi3EnterStepMode(c);
            fmi3EvaluateDiscreteStates(c);
            fmi3GetOutputDerivatives(c, references, n, wholes, found, m);
            fmi3GetNumberOfVariableDependencies(c, references[0], &size);
            fmi3ActivateModelPartition(c, references[0], reals[0]);
            break;
        case 27:
            fmi3UpdateDiscreteStates(c, truths, truths + 1, truths + 2, truths + 3, truths + 4, found);
            fmi3EnterContinuousTimeMode(c);
            fmi3EnterEventMode(c);
            break;
        case 28:
            size = below(4) ? N_STATES : below(N_STATES + 3);
            fmi3SetTime(c, reals[0]);
            if (!fmi3GetContinuousStates(c, x, size)) {
                x[0] = below(4) && N_STATES > 0 ? x[0] : any_number();
                fmi3SetContinuousStates(c, x, size);
            }
            fmi3GetContinuousStateDerivatives(c, x, size);
            fmi3GetNominalsOfContinuousStates(c, x, size);
            {
                double left[N_INDICATORS + 3];
                fmi3GetEventIndicators(c, left, below(4) ? N_INDICATORS : below(N_INDICATORS + 3));
            }
            fmi3CompletedIntegratorStep(c, below(2), truths, truths + 1);
            break;
        default:
            if (c && !below(6)) {
                for (k = 0; k < STATES; k++) { /* a host frees what it took before the instance */
                    if (owner[k] == c) {
                        fmi3FreeFMUState(c, &states[k]);
                        owner[k] = NULL;
                    }
                }
                fmi3FreeInstance(c);
                slaves[at] = NULL;
            }
        }
    }
    for (k = 0; k < STATES; k++) {
        if (owner[k]) {
            fmi3FreeFMUState(owner[k], &states[k]);
        }
    }
    for (k = 0; k < SLAVES; k++) {
        fmi3FreeInstance(slaves[k]);
    }
    return calls;
}
