/* What the FMI 2.0 slaves here do alike: nothing to set up, one kind of number, no state to be kept unless STATES is defined. */
#include <stddef.h>
#include <stdlib.h>

typedef void *Component;
typedef unsigned int Reference;
typedef int Status;

void fmi2FreeInstance(Component c) { free(c); }
Status fmi2SetupExperiment(Component c, int d, double tol, double begin, int s, double stop) { return 0; }
Status fmi2EnterInitializationMode(Component c) { return 0; }
Status fmi2ExitInitializationMode(Component c) { return 0; }
Status fmi2Terminate(Component c) { return 0; }
#define NONE(name, ...) Status name(__VA_ARGS__) { return 3; }
NONE(fmi2SetInteger, Component c) NONE(fmi2GetInteger, Component c) NONE(fmi2SetBoolean, Component c)
NONE(fmi2GetBoolean, Component c) NONE(fmi2SetString, Component c) NONE(fmi2GetString, Component c)
NONE(fmi2SetDebugLogging, Component c) NONE(fmi2CancelStep, Component c) NONE(fmi2SerializedFMUstateSize, Component c)
NONE(fmi2SerializeFMUstate, Component c) NONE(fmi2DeSerializeFMUstate, Component c)
NONE(fmi2GetDirectionalDerivative, Component c) NONE(fmi2SetRealInputDerivatives, Component c)
NONE(fmi2GetRealOutputDerivatives, Component c) NONE(fmi2GetStatus, Component c) NONE(fmi2GetRealStatus, Component c)
NONE(fmi2GetIntegerStatus, Component c) NONE(fmi2GetBooleanStatus, Component c) NONE(fmi2GetStringStatus, Component c)
#ifndef STATES
NONE(fmi2GetFMUstate, Component c) NONE(fmi2SetFMUstate, Component c) NONE(fmi2FreeFMUstate, Component c)
#endif
const char *fmi2GetTypesPlatform(void) { return "default"; }
const char *fmi2GetVersion(void) { return "2.0"; }
