/* The kernels for this processor, and what their code expects around it. */
#include <stdarg.h>
#include <stdio.h>
#include <string.h>
#include "core.h"
#include "processor.h"

void core_say(char *why, const char *format, ...) {
    if (why == NULL)
        return;
    va_list given;
    va_start(given, format);
    vsnprintf(why, JAWARI_WHY, format, given);
    va_end(given);
}

const char *jawari_version(void) { return core_made.version; }

const char *jawari_kernels_version(void) { return core_made.marks + sizeof "jawari-kernels:" - 1; }

/* ---- levels ---- */

static system_once chosen_once;
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
    int level = processor_level();
    /* as if the processor were an older one, to compare and to test */
    const char *most = system_variable("JAWARI_LEVEL");
    if (most != NULL && strncmp(most, "x86-64-v", 8) == 0 && most[8] >= '1' && most[8] - '0' < level)
        level = most[8] - '0';
    for (int32_t k = 0; k < core_made.levels; k++) {
        const struct core_level *fitting = &core_made.level[k];
        if (fitting->least > level)
            continue;
        chosen = fitting->kernels;
        chosen_name = fitting->name;
        if (most != NULL && strcmp(most, chosen_name) == 0)
            break;
    }
    if (chosen == NULL)
        return;
    complete = true;
    /* the types are those that emit.py has written these functions with */
    chosen_calls.process = (void (*)(int64_t, int64_t, int64_t, int64_t, int64_t, int64_t, int64_t, int64_t, int64_t, int64_t,
                                     int64_t))(void *)found("engine.process:process");
    chosen_calls.attend = (void (*)(int64_t, int64_t, int64_t))(void *)found("engine.team:_attend");
    chosen_calls.take = (int64_t(*)(int64_t, int64_t))(void *)found("engine.team:take_instruments");
    chosen_calls.enable_ftz = (int64_t(*)(void))(void *)found("native.denormals:enable_ftz");
    chosen_calls.restore = (void (*)(int64_t))(void *)found("native.denormals:restore");
}

const struct core_calls *core_kernels(char *why) {
    system_do_once(&chosen_once, choose);
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

#define HIDDEN __attribute__((visibility("hidden")))

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
