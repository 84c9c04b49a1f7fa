/* An FMU around the model in model.h: FMI_VERSION says which standard its functions follow, the rest is the same.

   No global state, and no allocation from the end of initialisation on. Bad use is refused with an error and a message that
   names the variable, its value and the limit; from then on steps are refused until a reset or a good state. Compile it
   alone, with this folder as include path and without contraction of floating-point operations:

       cc -std=c99 -O2 -ffp-contract=off -fPIC -shared -fvisibility=hidden fmu.c -lm -o NAME.so

   Define FMI2_FUNCTION_PREFIX or FMI3_FUNCTION_PREFIX to link several of them into one program. */

#include "semantics.h"

#include "model.h"

/* How the standard names things, for messages */
#if FMI_VERSION == 3
#define FMI "fmi3"
#define REAL "Float64"
#define WHOLE "Int32"
#define TOKEN "instantiation token"
#else
#define FMI "fmi2"
#define REAL "Real"
#define WHOLE "Integer"
#define TOKEN "GUID"
#endif

#include "instance.h"

#include "tables.h"

#include "saved.h"

#include "stepping.h"

#include "exchange.h"

#include "life.h"

#include "values.h"

#if FMI_VERSION == 3
#include "fmi3.h"
#else
#include "fmi2.h"
#endif
