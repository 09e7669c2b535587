/* The kernels for this processor, and what their code expects around it. */
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "core.h"

#if defined(__x86_64__)
#include <cpuid.h>
#endif

#ifndef JAWARI_VERSION
#define JAWARI_VERSION "unknown"
#endif
#ifndef JAWARI_KERNELS
#define JAWARI_KERNELS "unknown"
#endif
#ifndef JAWARI_SOURCES
#define JAWARI_SOURCES "unknown"
#endif

void core_say(char *why, const char *format, ...) {
    if (why == NULL)
        return;
    va_list given;
    va_start(given, format);
    vsnprintf(why, JAWARI_WHY, format, given);
    va_end(given);
}

const char *jawari_version(void) { return JAWARI_VERSION; }

/* found in the file by `library.version_of` and `sources_of` */
static const char marked_version[] = "jawari-kernels:" JAWARI_KERNELS "\0jawari-sources:" JAWARI_SOURCES;
const char *jawari_kernels_version(void) { return marked_version + sizeof "jawari-kernels:" - 1; }

/* ---- levels ---- */

#if defined(__x86_64__)
/* What the system saves of the vector registers when it changes threads. */
static uint64_t saved_registers(void) {
    uint32_t low, high;
    __asm__ volatile("xgetbv" : "=a"(low), "=d"(high) : "c"(0));
    return (uint64_t)high << 32 | low;
}

static int level_of_processor(void) {
    uint32_t a, b, c, d, b7, extended;
    /* of leaf 1: SSE3, SSSE3, FMA, CMPXCHG16B, SSE4.1, SSE4.2, MOVBE, POPCNT, OSXSAVE, AVX, F16C */
    const uint32_t wanted_1 = 1u << 0 | 1u << 9 | 1u << 12 | 1u << 13 | 1u << 19 | 1u << 20 | 1u << 22 | 1u << 23 | 1u << 27 |
                              1u << 28 | 1u << 29;
    const uint32_t wanted_7 = 1u << 3 | 1u << 5 | 1u << 8; /* BMI1, AVX2, BMI2 */
    const uint32_t wanted_512 = 1u << 16 | 1u << 17 | 1u << 28 | 1u << 30 | 1u << 31; /* F, DQ, CD, BW, VL */
    if (!__get_cpuid(1, &a, &b, &c, &d) || (c & wanted_1) != wanted_1)
        return 0;
    if (!__get_cpuid_count(7, 0, &a, &b7, &c, &d) || (b7 & wanted_7) != wanted_7)
        return 0;
    if (!__get_cpuid(0x80000001u, &a, &b, &extended, &d) || !(extended & 1u << 5)) /* LZCNT */
        return 0;
    const uint64_t saved = saved_registers();
    if ((saved & 0x06) != 0x06) /* XMM, YMM */
        return 0;
    return (b7 & wanted_512) == wanted_512 && (saved & 0xe6) == 0xe6 ? 4 : 3; /* …, masks, ZMM */
}
#else
static int level_of_processor(void) { return 1; }
#endif

#define HIDDEN __attribute__((visibility("hidden")))
#ifdef JAWARI_HAS_x86_64_v3
extern const struct kernels jawari_kernels_x86_64_v3 HIDDEN;
#endif
#ifdef JAWARI_HAS_aarch64
extern const struct kernels jawari_kernels_aarch64 HIDDEN;
#endif
#ifdef JAWARI_HAS_x86_64_v4
extern const struct kernels jawari_kernels_x86_64_v4 HIDDEN;
#endif

static pthread_once_t chosen_once = PTHREAD_ONCE_INIT;
static const struct kernels *chosen;
static const char *chosen_name;
static struct core_calls chosen_calls;
static bool complete;

static core_function *found(const char *name) {
    for (int64_t k = 0; k < chosen->count; k++)
        if (strcmp(chosen->list[k].name, name) == 0)
            return chosen->list[k].address;
    complete = false;
    return NULL;
}

static void choose(void) {
    int level = level_of_processor();
    /* as if the processor were an older one, to compare and to test */
    const char *most = getenv("JAWARI_LEVEL");
    if (most != NULL && strncmp(most, "x86-64-v", 8) == 0 && most[8] >= '1' && most[8] - '0' < level)
        level = most[8] - '0';
#ifdef JAWARI_HAS_x86_64_v3
    if (level >= 3) {
        chosen = &jawari_kernels_x86_64_v3;
        chosen_name = "x86-64-v3";
    }
#endif
#ifdef JAWARI_HAS_x86_64_v4
    if (level >= 4) {
        chosen = &jawari_kernels_x86_64_v4;
        chosen_name = "x86-64-v4";
    }
#endif
#ifdef JAWARI_HAS_aarch64
    if (level >= 1) { /* all of them are the same */
        chosen = &jawari_kernels_aarch64;
        chosen_name = "aarch64";
    }
#endif
    if (chosen == NULL)
        return;
    complete = true;
    /* the types are those that emit.py has written these functions with */
    chosen_calls.process = (void (*)(int64_t, int64_t, int64_t, int64_t, int64_t, int64_t, int64_t, int64_t, int64_t, int64_t,
                                     int64_t))(void *)found("engine.process:process");
    chosen_calls.attend = (void (*)(int64_t, int64_t, int64_t))(void *)found("engine.team:_attend");
    chosen_calls.take = (int64_t(*)(int64_t, int64_t))(void *)found("engine.team:_take");
    chosen_calls.enable_ftz = (int64_t(*)(void))(void *)found("native.denormals:enable_ftz");
    chosen_calls.restore = (void (*)(int64_t))(void *)found("native.denormals:restore");
}

const struct core_calls *core_kernels(char *why) {
    pthread_once(&chosen_once, choose);
    if (chosen == NULL) {
        core_say(why, "this processor lacks what the sound is computed with (AVX2 and FMA, x86-64-v3: Intel from 2013, AMD from "
                      "2015 on); play on a newer one");
        return NULL;
    }
    if (!complete) {
        core_say(why, "this library was built of parts that do not belong together; build it again");
        return NULL;
    }
    return &chosen_calls;
}

core_function *core_find(const char *name) {
    if (core_kernels(NULL) == NULL)
        return NULL;
    for (int64_t k = 0; k < chosen->count; k++)
        if (strcmp(chosen->list[k].name, name) == 0)
            return chosen->list[k].address;
    return NULL;
}

void *jawari_kernel(const char *name) { return name == NULL ? NULL : (void *)core_find(name); }

const char *jawari_processor(char *why) { return core_kernels(why) == NULL ? NULL : chosen_name; }

/* ---- what Numba's code names ---- */

/* Strides of an array of another shape on the same elements; 0: it would have to be copied. Kernels ask it of contiguous arrays
 * only, and of those it can always be had. */
HIDDEN int numba_attempt_nocopy_reshape(int64_t axes, const int64_t *shape, const int64_t *strides, int64_t new_axes,
                                        const int64_t *new_shape, int64_t *new_strides, int64_t item, int is_fortran);
int numba_attempt_nocopy_reshape(int64_t axes, const int64_t *shape, const int64_t *strides, int64_t new_axes,
                                 const int64_t *new_shape, int64_t *new_strides, int64_t item, int is_fortran) {
    int64_t expected = item;
    if (is_fortran)
        return 0;
    for (int64_t k = axes - 1; k >= 0; k--) {
        if (shape[k] != 1 && strides[k] != expected)
            return 0;
        expected *= shape[k];
    }
    expected = item;
    for (int64_t k = new_axes - 1; k >= 0; k--) {
        new_strides[k] = expected;
        expected *= new_shape[k];
    }
    return 1;
}

/* Of arrays that are counted; kernels make none. */
HIDDEN void NRT_MemInfo_call_dtor(void *counted);
void NRT_MemInfo_call_dtor(void *counted) { (void)counted; }
