/* Loads a library of a Mac into a program of Linux on the same kind of processor, so that its code runs where no Mac is.

   Compiled with host.c and -Ddlopen=mac_open -Ddlsym=mac_symbol -Ddlerror=mac_error. It knows what Apple's loader does with a
   library of plain C (mach-o/loader.h, mach-o/fat.h): its part of a universal file, segments, rebase and bind opcodes, exports.
   What it imports from libSystem is taken from this system's libraries. Apple's ARM passes variable arguments otherwise than
   Linux: those of sprintf, snprintf and vsnprintf are brought over, those of the host's logger, which hears of failures only, are not. */
#define _GNU_SOURCE
#undef dlopen
#undef dlsym
#undef dlerror
#include <dlfcn.h>
#include <stdarg.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>

#if defined __aarch64__
#define KIND 0x0100000cu
#else
#define KIND 0x01000007u
#endif
#define MOST 16

typedef struct { uint32_t cmd, size; char name[16]; uint64_t address, length, offset, held; uint32_t rest[4]; } Segment;
typedef struct { uint32_t cmd, size, rebase, rebase_size, bind, bind_size, weak, weak_size, lazy, lazy_size, exports, exports_size; } Info;
typedef struct { unsigned char *base; const unsigned char *exports; } Library;

static char message[300];
static Library libraries[MOST];
static int number;

char *mac_error(void) { return message; }

static void *failed(const char *what, const char *which)
{
    snprintf(message, sizeof message, "%s: %.200s", what, which);
    return NULL;
}

#if defined __aarch64__
/* On Apple's ARM variable arguments lie on the stack, 8 bytes each, as those of Linux do once its registers are used up. */
int mac_vsnprintf(char *text, size_t most, const char *format, void *arguments)
{
    va_list list;
    struct { void *stack, *general, *vector; int general_left, vector_left; } all = {arguments, NULL, NULL, 0, 0};
    memcpy(&list, &all, sizeof all);
    return vsnprintf(text, most, format, list);
}
int mac_vsprintf(char *text, const char *format, void *arguments) { return mac_vsnprintf(text, (size_t)1 << 20, format, arguments); }
int mac_snprintf(void), mac_sprintf(void);
__asm__(".globl mac_snprintf, mac_sprintf\n mac_snprintf: mov x3, sp\n b mac_vsnprintf\n mac_sprintf: mov x2, sp\n b mac_vsprintf\n");
#endif

static void *imported(const char *name)
{
#if defined __aarch64__
    if (!strcmp(name, "snprintf")) return (void *)mac_snprintf;
    if (!strcmp(name, "sprintf")) return (void *)mac_sprintf;
    if (!strcmp(name, "vsnprintf")) return (void *)mac_vsnprintf;
#endif
    return dlsym(RTLD_DEFAULT, !strcmp(name, "__bzero") ? "bzero" : name);
}

static uint64_t leb(const unsigned char **p)
{
    uint64_t value = 0;
    int shift = 0;
    do { value |= (uint64_t)(**p & 0x7f) << shift; shift += 7; } while (*(*p)++ & 0x80);
    return value;
}

/* Opcodes of a table of rebases (symbols NULL: add the slide) or of binds (put in what the name stands for). */
static int applied(const unsigned char *p, size_t size, unsigned char *base, unsigned char *const *segments, int binds)
{
    const unsigned char *end = p + size;
    unsigned char *at = base;
    const char *name = "";
    int64_t added = 0;
    while (p < end) {
        int code = *p & 0xf0, low = *p & 0x0f;
        uint64_t times = 0, skip = 0;
        p++;
        if (!binds) {
            if (code == 0x10) continue;                                        /* kind of pointer */
            else if (code == 0x20) at = segments[low] + leb(&p);
            else if (code == 0x30) at += leb(&p);
            else if (code == 0x40) at += 8 * (size_t)low;
            else if (code == 0x50) times = (uint64_t)low;
            else if (code == 0x60) times = leb(&p);
            else if (code == 0x70) { times = 1; skip = leb(&p); }
            else if (code == 0x80) { times = leb(&p); skip = leb(&p); }
            else if (code != 0) return 0;
            for (; times; times--, at += 8 + skip) *(uint64_t *)(void *)at += (uint64_t)(uintptr_t)base;
            continue;
        }
        if (code == 0x00 || code == 0x10 || code == 0x30 || code == 0x50) continue; /* done, which library, kind of pointer */
        else if (code == 0x20) leb(&p);
        else if (code == 0x40) { name = (const char *)p; p += strlen(name) + 1; }
        else if (code == 0x60) added = (int64_t)leb(&p);
        else if (code == 0x70) at = segments[low] + leb(&p);
        else if (code == 0x80) at += leb(&p);
        else if (code == 0x90) times = 1;
        else if (code == 0xa0) { times = 1; skip = leb(&p); }
        else if (code == 0xb0) { times = 1; skip = 8 * (uint64_t)low; }
        else if (code == 0xc0) { times = leb(&p); skip = leb(&p); }
        else return 0;
        for (; times; times--, at += 8 + skip) {
            char *found = imported(name + 1);
            if (!found && strcmp(name, "dyld_stub_binder")) { failed("not known here", name); return 0; }
            *(uint64_t *)(void *)at = (uint64_t)(uintptr_t)found + (uint64_t)added;
        }
    }
    return 1;
}

static unsigned whole(const unsigned char *p) { return (unsigned)p[0] << 24 | (unsigned)p[1] << 16 | (unsigned)p[2] << 8 | p[3]; }

void *mac_open(const char *path, int how)
{
    FILE *file = fopen(path, "rb");
    (void)how;
    if (!file || number == MOST) return failed("cannot be opened", path);
    fseek(file, 0, SEEK_END);
    size_t size = (size_t)ftell(file);
    unsigned char *data = malloc(size);
    rewind(file);
    if (!data || fread(data, 1, size, file) != size) return failed("cannot be read", path);
    fclose(file);
    const unsigned char *image = data;
    if (whole(data) == 0xcafebabeu)
        for (unsigned k = 0; k < whole(data + 4); k++)
            if (whole(data + 8 + 20 * k) == KIND) image = data + whole(data + 16 + 20 * k);
    const uint32_t *head = (const uint32_t *)(const void *)image;
    if (head[0] != 0xfeedfacfu || head[1] != KIND) return failed("holds no code for this processor", path);

    Segment segment[8];
    unsigned char *places[8];
    Info info = {0};
    int segments = 0;
    size_t end = 0;
    const unsigned char *command = image + 32;
    for (uint32_t k = 0; k < head[4]; k++, command += ((const uint32_t *)(const void *)command)[1]) {
        uint32_t kind = *(const uint32_t *)(const void *)command;
        if (kind == 0x19 && segments < 8) {
            memcpy(&segment[segments], command, sizeof(Segment));
            end = (size_t)(segment[segments].address + segment[segments].length);
            segments++;
        } else if (kind == 0x22 || kind == 0x80000022u) memcpy(&info, command, sizeof info);
        else if (kind == 0x0c && strcmp((const char *)command + *(const uint32_t *)(const void *)(command + 8), "/usr/lib/libSystem.B.dylib"))
            return failed("needs more than libSystem", (const char *)command + 24);
    }
    unsigned char *base = mmap(NULL, end, PROT_READ | PROT_WRITE | PROT_EXEC, MAP_PRIVATE | MAP_ANONYMOUS, -1, 0);
    if (base == MAP_FAILED || !info.exports_size) return failed("has no place or no exports", path);
    for (int k = 0; k < segments; k++) {
        places[k] = base + segment[k].address;
        memcpy(places[k], image + segment[k].offset, (size_t)segment[k].held);
    }
    if (!applied(image + info.rebase, info.rebase_size, base, places, 0) || !applied(image + info.bind, info.bind_size, base, places, 1)
        || !applied(image + info.lazy, info.lazy_size, base, places, 1))
        return message[0] ? NULL : failed("has opcodes that are not known", path);
    __builtin___clear_cache((char *)base, (char *)base + end);
    libraries[number].base = base;
    libraries[number].exports = image + info.exports;
    return &libraries[number++];
}

/* The exports are a tree whose edges are pieces of names. */
void *mac_symbol(void *library, const char *name)
{
    const Library *own = library;
    const unsigned char *node = own->exports;
    char wanted[100], *rest = wanted;
    snprintf(wanted, sizeof wanted, "_%s", name);
    for (;;) {
        uint64_t length = leb(&node);
        if (!*rest) {
            if (!length) return NULL;
            leb(&node);
            return own->base + leb(&node);
        }
        node += length;
        const unsigned char *next = NULL;
        for (int edges = *node++; edges; edges--) {
            size_t part = strlen((const char *)node);
            int fits = !strncmp(rest, (const char *)node, part);
            node += part + 1;
            uint64_t offset = leb(&node);
            if (fits && !next) { next = own->exports + offset; rest += part; }
        }
        if (!next) return NULL;
        node = next;
    }
}
