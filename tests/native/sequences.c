/* Any calls of FMI 2.0 in any order, drawn by a seed, under the sanitizers: an FMU must answer each, and harm nothing.

   sequences RESOURCES GUID SEED CALLS: prints the number of calls made; an error of memory or an undefined operation ends
   it. Up to SLAVES instances live at once; states, buffers and references are right three times in four. */

#include "fmu.c"

#include <stdarg.h>

#include "drawn.h"

static void logger(fmi2ComponentEnvironment environment, fmi2String name, fmi2Status status, fmi2String category,
                   fmi2String message, ...) {
    char text[4096];
    va_list rest;
    (void)environment;
    (void)name;
    (void)status;
    (void)category;
    va_start(rest, message);
    vsnprintf(text, sizeof text, message, rest); /* read, so that a bad pointer shows */
    va_end(rest);
}

static const fmi2CallbackFunctions host = {logger, calloc, free, NULL, NULL};

static unsigned long sequence(const char *resources, const char *token, unsigned long most) {
    fmi2Component slaves[SLAVES] = {NULL};
    fmi2FMUstate states[STATES] = {NULL};
    fmi2Component owner[STATES] = {NULL}; /* a state belongs to the instance that gave it */
    fmi2Byte bytes[sizeof(Saved) + 8];
    unsigned long calls;
    size_t size;
    unsigned k, n;
    memset(bytes, 0, sizeof bytes);
    for (calls = 0; another(calls, most); calls++) {
        const unsigned at = below(SLAVES), s = below(STATES);
        fmi2Component c = slaves[at];
        fmi2ValueReference references[MOST];
        double reals[MOST];
        fmi2Integer wholes[MOST], orders[MOST];
        fmi2Boolean truths[MOST];
        fmi2String texts[MOST];
        const fmi2String categories[] = {"logStatusError", "logAll", "no such one"};
        n = below(MOST + 1);
        for (k = 0; k < MOST; k++) {
            references[k] = reference();
            reals[k] = any_number();
            wholes[k] = below(2) ? (fmi2Integer)below(5) : (fmi2Integer)drawn();
            orders[k] = below(3) ? 1 + (fmi2Integer)below(3) : (fmi2Integer)drawn();
            truths[k] = (fmi2Boolean)below(3);
            texts[k] = "text";
        }
        if (!c) { /* NULL is refused by every function; most often an instance is made */
            if (below(8)) {
                const fmi2Type type = below(4) ? fmi2CoSimulation : fmi2ModelExchange;
                const fmi2String guid = below(16) ? token : "{wrong}";
                slaves[at] = fmi2Instantiate("a", type, guid, below(16) ? resources : "file:///nowhere", &host, 0, (fmi2Boolean)below(2));
                continue;
            }
        }
        switch (below(34)) {
        case 0: fmi2SetupExperiment(c, truths[0], reals[0], below(2) ? 0.0 : reals[1], truths[1], reals[2]); break;
        case 1: case 2: fmi2SetupExperiment(c, fmi2False, 0.0, 0.0, fmi2False, 0.0); break;
        case 3: case 4: case 5: fmi2EnterInitializationMode(c); break;
        case 6: case 7: case 8: fmi2ExitInitializationMode(c); break;
        case 9: case 10: case 11: fmi2DoStep(c, below(4) ? calls * 1e-3 : reals[0], below(4) ? 1e-3 : reals[1], truths[0]); break;
        case 12: case 13: fmi2SetReal(c, references, n, reals); break;
        case 14: fmi2GetReal(c, references, n, reals); break;
        case 15: fmi2SetInteger(c, references, n, wholes); break;
        case 16: fmi2GetInteger(c, references, n, wholes); break;
        case 17: fmi2SetBoolean(c, references, n, truths); fmi2GetBoolean(c, references, n, truths); break;
        case 18: fmi2SetString(c, references, n, texts); fmi2GetString(c, references, n, texts); break;
        case 19: fmi2SetRealInputDerivatives(c, references, n, orders, reals); break;
        case 20: fmi2GetRealOutputDerivatives(c, references, n, orders, reals); break;
        case 21: fmi2GetDirectionalDerivative(c, references, n, references + below(2), below(MOST), reals, reals); break;
        case 22:
            if (!states[s] || owner[s] == c) {
                fmi2GetFMUstate(c, &states[s]);
                owner[s] = states[s] ? c : NULL;
            }
            break;
        case 23: fmi2SetFMUstate(c, owner[s] == c ? states[s] : NULL); break;
        case 24:
            if (owner[s] == c && states[s] && !fmi2SerializedFMUstateSize(c, states[s], &size) && size <= sizeof bytes) {
                fmi2SerializeFMUstate(c, states[s], bytes, below(8) ? size : below((unsigned)size));
            }
            break;
        case 25:
            if (below(2)) {
                bytes[below(sizeof bytes)] ^= (fmi2Byte)(1u << below(8));
            }
            if (!states[s] || owner[s] == c) {
                fmi2DeSerializeFMUstate(c, bytes, below(8) ? sizeof(Saved) : below(sizeof(Saved)), &states[s]);
                owner[s] = states[s] ? c : NULL;
            }
            break;
        case 26:
            if (owner[s] == c && c) {
                fmi2FreeFMUstate(c, &states[s]);
                owner[s] = NULL;
            }
            break;
        case 27: fmi2Terminate(c); break;
        case 28: fmi2Reset(c); break;
        case 29: fmi2SetDebugLogging(c, truths[0], below(4), categories); break;
        case 30:
            fmi2CancelStep(c);
            fmi2GetStatus(c, (fmi2StatusKind)below(5), (fmi2Status *)&wholes[0]);
            fmi2GetRealStatus(c, (fmi2StatusKind)below(5), reals);
            fmi2GetIntegerStatus(c, (fmi2StatusKind)below(5), wholes);
            fmi2GetBooleanStatus(c, (fmi2StatusKind)below(5), truths);
            fmi2GetStringStatus(c, (fmi2StatusKind)below(5), texts);
            break;
        case 31: {
            fmi2EventInfo info;
            fmi2NewDiscreteStates(c, &info);
            fmi2EnterContinuousTimeMode(c);
            fmi2EnterEventMode(c);
            break;
        }
        case 32: {
            double x[N_STATES + 3];
            size = below(4) ? N_STATES : below(N_STATES + 3);
            fmi2SetTime(c, reals[0]);
            if (!fmi2GetContinuousStates(c, x, size)) {
                x[0] = below(4) && N_STATES > 0 ? x[0] : any_number();
                fmi2SetContinuousStates(c, x, size);
            }
            fmi2GetDerivatives(c, x, size);
            fmi2GetNominalsOfContinuousStates(c, x, size);
            {
                double left[N_INDICATORS + 3];
                fmi2GetEventIndicators(c, left, below(4) ? N_INDICATORS : below(N_INDICATORS + 3));
            }
            fmi2CompletedIntegratorStep(c, truths[0], &truths[1], &truths[2]);
            break;
        }
        default:
            if (c && !below(6)) {
                for (k = 0; k < STATES; k++) { /* a host frees what it took before the instance */
                    if (owner[k] == c) {
                        fmi2FreeFMUstate(c, &states[k]);
                        owner[k] = NULL;
                    }
                }
                fmi2FreeInstance(c);
                slaves[at] = NULL;
            }
        }
    }
    for (k = 0; k < STATES; k++) {
        if (owner[k]) {
            fmi2FreeFMUstate(owner[k], &states[k]);
        }
    }
    for (k = 0; k < SLAVES; k++) {
        fmi2FreeInstance(slaves[k]);
    }
    return calls;
}
