/* An FMU of FMI 3.0 whose outputs are its inputs of every type, a step late; it can end a simulation, or a step early. */

#include <stdlib.h>
#include <string.h>

#include "fmi3Functions.h"

#define UNUSED(x) (void)(x)

enum { ENDS = 200, EARLY, BAD, CLOCK, TEXT };

static fmi3LogMessageCallback tell;
static void *environment;
static double now, ends, early;
static char text[16];

#define ECHO(kind, code) \
    static fmi3##kind in_##kind, out_##kind; \
    static fmi3Status set_##kind(const fmi3ValueReference r[], size_t n, const fmi3##kind values[], size_t m) { \
        for (size_t k = 0; k < n; k++) { \
            if (r[k] != code || n != m) { \
                return fmi3Error; \
            } \
            in_##kind = values[k]; \
        } \
        return fmi3OK; \
    } \
    static fmi3Status get_##kind(const fmi3ValueReference r[], size_t n, fmi3##kind values[], size_t m) { \
        for (size_t k = 0; k < n; k++) { \
            if ((r[k] != code && r[k] != code + 1) || n != m) { \
                return fmi3Error; \
            } \
            values[k] = r[k] == code ? in_##kind : out_##kind; \
        } \
        return fmi3OK; \
    }

#define PLAIN(kind, code) \
    ECHO(kind, code) \
    fmi3Status fmi3Set##kind(fmi3Instance c, const fmi3ValueReference r[], size_t n, const fmi3##kind values[], size_t m) { \
        UNUSED(c); \
        return set_##kind(r, n, values, m); \
    } \
    fmi3Status fmi3Get##kind(fmi3Instance c, const fmi3ValueReference r[], size_t n, fmi3##kind values[], size_t m) { \
        UNUSED(c); \
        return get_##kind(r, n, values, m); \
    }

PLAIN(Float32, 10)
PLAIN(Int8, 20)
PLAIN(UInt8, 30)
PLAIN(Int16, 40)
PLAIN(UInt16, 50)
PLAIN(Int32, 60)
PLAIN(UInt32, 70)
PLAIN(UInt64, 90)
PLAIN(Boolean, 100)
ECHO(Float64, 0)

/* an enumeration is one too */
static fmi3Int64 in_Int64, out_Int64, in_Enumeration, out_Enumeration;

fmi3Status fmi3SetInt64(fmi3Instance c, const fmi3ValueReference r[], size_t n, const fmi3Int64 values[], size_t m) {
    UNUSED(c);
    UNUSED(m);
    for (size_t k = 0; k < n; k++) {
        *(r[k] == 80 ? &in_Int64 : &in_Enumeration) = values[k];
    }
    return fmi3OK;
}

fmi3Status fmi3GetInt64(fmi3Instance c, const fmi3ValueReference r[], size_t n, fmi3Int64 values[], size_t m) {
    UNUSED(c);
    UNUSED(m);
    for (size_t k = 0; k < n; k++) {
        values[k] = r[k] == 81 ? out_Int64 : r[k] == 111 ? out_Enumeration : r[k] == 80 ? in_Int64 : in_Enumeration;
    }
    return fmi3OK;
}

fmi3Status fmi3SetFloat64(fmi3Instance c, const fmi3ValueReference r[], size_t n, const fmi3Float64 values[], size_t m) {
    UNUSED(c);
    if (n == 1 && r[0] >= ENDS) {
        *(r[0] == ENDS ? &ends : &early) = values[0];
        return fmi3OK;
    }
    if (n == 1 && values[0] > 99.0) {
        tell(environment, fmi3Error, "logStatusError", "100 %s is too much");
        return fmi3Error;
    }
    return set_Float64(r, n, values, m);
}

fmi3Status fmi3GetFloat64(fmi3Instance c, const fmi3ValueReference r[], size_t n, fmi3Float64 values[], size_t m) {
    UNUSED(c);
    return get_Float64(r, n, values, m);
}

fmi3Status fmi3SetString(fmi3Instance c, const fmi3ValueReference r[], size_t n, const fmi3String values[], size_t m) {
    UNUSED(c);
    UNUSED(m);
    if (n != 1 || r[0] != TEXT || strlen(values[0]) >= sizeof text) {
        return fmi3Error;
    }
    strcpy(text, values[0]);
    return fmi3OK;
}

fmi3Status fmi3GetString(fmi3Instance c, const fmi3ValueReference r[], size_t n, fmi3String values[], size_t m) {
    UNUSED(c);
    UNUSED(r);
    UNUSED(m);
    for (size_t k = 0; k < n; k++) {
        values[k] = text;
    }
    return fmi3OK;
}

static fmi3Status begin(void) {
    now = 0.0;
    ends = early = 1e9;
    in_Float64 = 0.5;
    strcpy(text, "none");
    return fmi3OK;
}

static void echo(void) {
    out_Float64 = strcmp(text, "minus") ? in_Float64 : -in_Float64;
    out_Float32 = in_Float32;
    out_Int8 = in_Int8;
    out_UInt8 = in_UInt8;
    out_Int16 = in_Int16;
    out_UInt16 = in_UInt16;
    out_Int32 = in_Int32;
    out_UInt32 = in_UInt32;
    out_Int64 = in_Int64;
    out_UInt64 = in_UInt64;
    out_Boolean = in_Boolean;
    out_Enumeration = in_Enumeration;
}

const char *fmi3GetVersion(void) { return fmi3Version; }

fmi3Instance fmi3InstantiateCoSimulation(fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible,
                                         fmi3Boolean logging, fmi3Boolean events, fmi3Boolean earlyAllowed,
                                         const fmi3ValueReference r[], size_t n, fmi3InstanceEnvironment of,
                                         fmi3LogMessageCallback log, fmi3IntermediateUpdateCallback update) {
    UNUSED(name);
    UNUSED(resources);
    UNUSED(visible);
    UNUSED(logging);
    UNUSED(r);
    UNUSED(update);
    tell = log;
    environment = of;
    begin();
    return strcmp(token, "{types}") || events || earlyAllowed || n ? NULL : (void *)&now;
}

void fmi3FreeInstance(fmi3Instance c) { UNUSED(c); }

fmi3Status fmi3SetDebugLogging(fmi3Instance c, fmi3Boolean on, size_t n, const fmi3String categories[]) {
    UNUSED(c);
    UNUSED(on);
    UNUSED(n);
    UNUSED(categories);
    return fmi3OK;
}

fmi3Status fmi3EnterInitializationMode(fmi3Instance c, fmi3Boolean hasTolerance, fmi3Float64 tolerance, fmi3Float64 start,
                                       fmi3Boolean hasStop, fmi3Float64 stop) {
    UNUSED(c);
    now = start;
    return hasTolerance && tolerance == 1e-4 && hasStop && stop > start ? fmi3OK : fmi3Error;
}

fmi3Status fmi3ExitInitializationMode(fmi3Instance c) {
    UNUSED(c);
    echo();
    return fmi3OK;
}

fmi3Status fmi3Terminate(fmi3Instance c) { return c ? fmi3OK : fmi3Error; }

fmi3Status fmi3Reset(fmi3Instance c) {
    UNUSED(c);
    return begin();
}

fmi3Status fmi3DoStep(fmi3Instance c, fmi3Float64 time, fmi3Float64 h, fmi3Boolean noSet, fmi3Boolean *event,
                      fmi3Boolean *end, fmi3Boolean *isEarly, fmi3Float64 *last) {
    UNUSED(c);
    echo();
    *event = false;
    *end = time + h > ends;
    *isEarly = time + h > early;
    *last = now = time + h;
    return noSet ? fmi3OK : fmi3Error;
}

#define NONE(name, ...) \
    fmi3Status fmi3##name(__VA_ARGS__) { return fmi3Error; }

NONE(GetFMUState, fmi3Instance c, fmi3FMUState *s)
NONE(SetFMUState, fmi3Instance c, fmi3FMUState s)
NONE(FreeFMUState, fmi3Instance c, fmi3FMUState *s)
NONE(SerializedFMUStateSize, fmi3Instance c, fmi3FMUState s, size_t *n)
NONE(SerializeFMUState, fmi3Instance c, fmi3FMUState s, fmi3Byte b[], size_t n)
NONE(DeserializeFMUState, fmi3Instance c, const fmi3Byte b[], size_t n, fmi3FMUState *s)
