/* What a plain C host hands to an FMU of FMI 2.0: where its messages go, and memory from calloc. */
#ifndef FMI2_CALLBACKS_H
#define FMI2_CALLBACKS_H
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>

typedef struct {
    void (*logger)(void *, const char *, int, const char *, const char *, ...);
    void *(*allocate)(size_t, size_t);
    void (*release)(void *);
    void (*finished)(void *, int);
    void *environment;
} Callbacks;

/* Messages of status OK are no news. */
static void logger(void *environment, const char *name, int status, const char *category, const char *message, ...)
{
    va_list rest;
    (void)environment; (void)name; (void)category;
    if (status == 0) return;
    va_start(rest, message);
    vfprintf(stderr, message, rest);
    va_end(rest);
    fputc('\n', stderr);
}

static const Callbacks callbacks = {logger, calloc, free, NULL, NULL};
#endif
