/* The part of a Modelica tool's header that the export uses; an error ends the process instead of the simulation. */
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>

static void ModelicaFormatError(const char *format, ...)
{
    va_list rest;
    va_start(rest, format);
    vfprintf(stderr, format, rest);
    va_end(rest);
    fflush(stderr);
    _Exit(9);
}

static void ModelicaError(const char *text) { ModelicaFormatError("%s", text); }
