/* What an S-function asks of Simulink, for tests without it: the calls of MathWorks' simstruc.h that ours make, and no others. */

#ifndef SIMSTRUC_H
#define SIMSTRUC_H

#include <stddef.h>
#include <string.h>

#define MOST 64

typedef int int_T;
typedef double real_T;
typedef const real_T *const *InputRealPtrsType;

typedef struct {
    const double *values; /* NULL of a text */
    size_t count;
    const char *text;
} mxArray;

typedef struct {
    const char *path, *error;
    double start, now, step, offset;
    int n_asked, n_given, n_inputs, n_outputs, n_work, sampled, exception_free;
    int widths[2][MOST], direct[MOST];
    mxArray given[MOST];
    const double *inputs[MOST];
    double outputs[MOST];
    void *work[1];
} SimStruct;

#define SS_OPTION_EXCEPTION_FREE_CODE 1

#define ssSetNumSFcnParams(S, n) ((S)->n_asked = (n))
#define ssGetNumSFcnParams(S) ((S)->n_asked)
#define ssGetSFcnParamsCount(S) ((S)->n_given)
#define ssGetSFcnParam(S, k) ((const mxArray *)&(S)->given[k])
#define ssSetSFcnParamTunable(S, k, yes) ((void)(k), (void)(yes))
#define ssSetNumContStates(S, n) ((void)(n))
#define ssSetNumDiscStates(S, n) ((void)(n))
#define ssSetNumInputPorts(S, n) ((S)->n_inputs = (n), (n) <= MOST)
#define ssSetNumOutputPorts(S, n) ((S)->n_outputs = (n), (n) <= MOST)
#define ssSetInputPortWidth(S, k, n) ((S)->widths[0][k] = (n))
#define ssSetOutputPortWidth(S, k, n) ((S)->widths[1][k] = (n))
#define ssSetInputPortDirectFeedThrough(S, k, yes) ((S)->direct[k] = (yes))
#define ssSetNumSampleTimes(S, n) ((S)->sampled = (n))
#define ssSetSampleTime(S, k, step_) ((S)->step = (step_))
#define ssSetOffsetTime(S, k, offset_) ((S)->offset = (offset_))
#define ssSetNumPWork(S, n) ((S)->n_work = (n))
#define ssGetPWorkValue(S, k) ((S)->work[k])
#define ssSetPWorkValue(S, k, value) ((S)->work[k] = (value))
#define ssSetOptions(S, options) ((S)->exception_free = (options) & SS_OPTION_EXCEPTION_FREE_CODE)
#define ssSetErrorStatus(S, text) ((S)->error = (text))
#define ssGetPath(S) ((S)->path)
#define ssGetT(S) ((S)->now)
#define ssGetTStart(S) ((S)->start)
#define ssGetInputPortRealSignalPtrs(S, k) ((InputRealPtrsType)&(S)->inputs[k])
#define ssGetOutputPortRealSignal(S, k) (&(S)->outputs[k])

#define mxGetNumberOfElements(a) ((a)->count)
#define mxGetPr(a) ((double *)(a)->values)
#define mxGetScalar(a) ((a)->values[0])
#define mxIsNumeric(a) ((a)->values != NULL)
#define mxIsComplex(a) 0

static int mxGetString(const mxArray *a, char *text, size_t size) {
    if (strlen(a->text) + 1 > size) {
        return 1;
    }
    strcpy(text, a->text);
    return 0;
}

#endif
