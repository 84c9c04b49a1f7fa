/* Freed blocks of the size of a shared_ptr's control block keep one use; releasing one a second time ends the process. */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <malloc.h>
#include <stdlib.h>
#include <string.h>
static const char mark[8] = "released";
static void (*real)(void *);
void free(void *p)
{
    if (!real) real = (void (*)(void *))dlsym(RTLD_NEXT, "free");
    size_t n = p ? malloc_usable_size(p) : 0;
    if (n < 104 || n > 248) { real(p); return; }
    char *end = (char *)p + n - sizeof mark;
    if (!memcmp(end, mark, sizeof mark)) abort();
    memcpy(end, mark, sizeof mark);
    ((int *)p)[2] = ((int *)p)[3] = 1;
}
