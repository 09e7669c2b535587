/* playtake LIBRARY BANK RATE FRAMES BLOCK EVENTS OUT [THREADS]: plays events with a native library, on the systems that it is
 * made for, with one thread unless told.
 *
 * EVENTS is a file of jawari_event, in order of their frames, which count from the beginning. OUT gets FRAMES frames of two
 * channels, as double, interleaved. Says what went wrong, with exit code 1. */
#include <stdio.h>
#include <stdlib.h>
#include "jawari.h"

#if defined(_WIN32)
#include <windows.h>
static void *opened(const char *path) { return (void *)LoadLibraryA(path); }
static void *found(void *library, const char *name) { return (void *)GetProcAddress((HMODULE)library, name); }
#else
#include <dlfcn.h>
static void *opened(const char *path) { return dlopen(path, RTLD_NOW | RTLD_LOCAL); }
static void *found(void *library, const char *name) { return dlsym(library, name); }
#endif

enum { MOST_EVENTS = 4096, MOST_FRAMES = 4096 };

static jawari_event events[MOST_EVENTS];
static double sides[2][MOST_FRAMES];

static int fail(const char *what, const char *why) {
    fprintf(stderr, "playtake: %s: %s\n", what, why);
    return 1;
}

int main(int given, char **argument) {
    if (given != 8 && given != 9)
        return fail("usage", "playtake LIBRARY BANK RATE FRAMES BLOCK EVENTS OUT [THREADS]");
    char why[JAWARI_WHY] = "it has no such function";
    const int threads = given == 9 ? atoi(argument[8]) : 1;
    const int frames = atoi(argument[4]), block = atoi(argument[5]);
    void *library = opened(argument[1]);
    if (library == NULL)
        return fail(argument[1], "cannot be loaded");
    jawari_bank *(*open)(const char *, char *) = (jawari_bank * (*)(const char *, char *)) found(library, "jawari_open");
    jawari_engine *(*create)(jawari_bank *, double, int32_t, char *) =
        (jawari_engine * (*)(jawari_bank *, double, int32_t, char *)) found(library, "jawari_create");
    void (*process)(jawari_engine *, const jawari_event *, int32_t, int32_t, double *, double *) =
        (void (*)(jawari_engine *, const jawari_event *, int32_t, int32_t, double *, double *))found(library, "jawari_process");
    jawari_bank *bank = open ? open(argument[2], why) : NULL;
    jawari_engine *engine = bank && create ? create(bank, atof(argument[3]), threads, why) : NULL;
    if (engine == NULL || process == NULL)
        return fail(argument[2], why);
    FILE *in = fopen(argument[6], "rb"), *out = fopen(argument[7], "wb");
    if (in == NULL || out == NULL || block < 1 || block > MOST_FRAMES)
        return fail(argument[6], "cannot be played");
    const int all = (int)fread(events, sizeof *events, MOST_EVENTS, in);
    for (int done = 0, first = 0, n, within; done < frames; done += n, first += within) {
        n = frames - done < block ? frames - done : block;
        for (within = 0; first + within < all && events[first + within].frame < done + n; within++)
            events[first + within].frame -= done;
        process(engine, &events[first], within, n, sides[0], sides[1]);
        for (int i = 0; i < n; i++)
            for (int side = 0; side < 2; side++)
                fwrite(&sides[side][i], sizeof **sides, 1, out);
    }
    return fclose(out) == 0 ? 0 : fail(argument[7], "cannot be written");
}
