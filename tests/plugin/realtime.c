/* realtime.c: what tests need of C around a plugin's audio thread.
 *
 * Loaded before all else (LD_PRELOAD) it counts what an audio thread must not do, in the threads and calls that ask for it:
 * memory that is allocated or freed, locks that are taken, files that are opened. Event lists that cost nothing and allocate
 * nothing stand here too, for a host in Python could not tell its own allocations from the plugin's.
 */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <fcntl.h>
#include <pthread.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

static __thread int watching;
static int64_t allocated, freed, locked, opened;

void *__libc_malloc(size_t);
void *__libc_calloc(size_t, size_t);
void *__libc_realloc(void *, size_t);
void *__libc_memalign(size_t, size_t);
void __libc_free(void *);

static void count(int64_t *what) {
    if (watching)
        __atomic_fetch_add(what, 1, __ATOMIC_RELAXED);
}

#ifdef COUNTING
void *malloc(size_t size) {
    count(&allocated);
    return __libc_malloc(size);
}
void *calloc(size_t n, size_t size) {
    count(&allocated);
    return __libc_calloc(n, size);
}
void *realloc(void *at, size_t size) {
    count(&allocated);
    return __libc_realloc(at, size);
}
void free(void *at) {
    if (at)
        count(&freed);
    __libc_free(at);
}
int posix_memalign(void **at, size_t alignment, size_t size) {
    count(&allocated);
    *at = __libc_memalign(alignment, size);
    return *at ? 0 : 12;
}
void *aligned_alloc(size_t alignment, size_t size) {
    count(&allocated);
    return __libc_memalign(alignment, size);
}
int pthread_mutex_lock(pthread_mutex_t *mutex) {
    static int (*real)(pthread_mutex_t *);
    if (!real)
        real = (int (*)(pthread_mutex_t *))dlsym(RTLD_NEXT, "pthread_mutex_lock");
    count(&locked);
    return real(mutex);
}
int open(const char *path, int flags, ...) {
    static int (*real)(const char *, int, ...);
    if (!real)
        real = (int (*)(const char *, int, ...))dlsym(RTLD_NEXT, "open");
    va_list given;
    va_start(given, flags);
    int mode = va_arg(given, int);
    va_end(given);
    count(&opened);
    return real(path, flags, mode);
}
#endif

/* Whether memory, locks and files are seen by it: they are where it was loaded before all else. */
int rt_sees(void) {
    static pthread_mutex_t mutex = PTHREAD_MUTEX_INITIALIZER;
    int64_t before[4] = {allocated, freed, locked, opened};
    watching = 1;
    void *volatile some = malloc(1);
    free(some);
    int file = open("/dev/null", O_RDONLY);
    pthread_mutex_lock(&mutex);
    watching = 0;
    pthread_mutex_unlock(&mutex);
    if (file >= 0)
        close(file);
    int all = allocated > before[0] && freed > before[1] && locked > before[2] && opened > before[3];
    allocated = before[0];
    freed = before[1];
    locked = before[2];
    opened = before[3];
    return all;
}

/* Memory, locks and files since the start, allocated, freed, locked, opened. */
void rt_counts(int64_t counts[4]) {
    int64_t all[4] = {allocated, freed, locked, opened};
    memcpy(counts, all, sizeof all);
}

/* ---- event lists: `ctx` stands at the head of both kinds ---- */

typedef struct rt_input {
    struct rt_input *self;
    uint32_t (*size)(const struct rt_input *);
    const void *(*get)(const struct rt_input *, uint32_t);
    const uint8_t *bytes; /* events, each in a place of `stride` */
    uint32_t count, stride, beyond;
} rt_input;

typedef struct rt_output {
    struct rt_output *self;
    bool (*try_push)(const struct rt_output *, const void *);
    uint8_t *bytes;
    uint32_t count, room, stride, refused;
} rt_output;

static uint32_t input_size(const rt_input *list) { return list->count; }

static const void *input_get(const rt_input *list, uint32_t k) {
    if (k >= list->count) {
        ((rt_input *)(uintptr_t)list)->beyond++;
        return NULL;
    }
    return list->bytes + (size_t)list->stride * k;
}

static bool output_push(const rt_output *list, const void *event) {
    rt_output *mine = (rt_output *)(uintptr_t)list;
    uint32_t size = *(const uint32_t *)event;
    if (mine->count == mine->room || size > mine->stride) {
        mine->refused++;
        return false;
    }
    memcpy(mine->bytes + (size_t)mine->stride * mine->count++, event, size);
    return true;
}

void rt_lists(rt_input *in, rt_output *out) {
    in->self = in;
    in->size = input_size;
    in->get = input_get;
    out->self = out;
    out->try_push = output_push;
}

/* process(plugin, block), watched. */
int32_t rt_process(int32_t (*process)(const void *, const void *), const void *plugin, const void *block) {
    watching = 1;
    int32_t status = process(plugin, block);
    watching = 0;
    return status;
}

/* `count` blocks without a pause, one behind the other in the buffers; `events` go into the first. The head of clap_process. */
typedef struct rt_block {
    int64_t steady_time;
    uint32_t frames;
    const void *transport, *inputs;
    struct {
        float **narrow;
        double **wide;
    } *outputs;
} rt_block;

int32_t rt_many(int32_t (*process)(const void *, const void *), const void *plugin, const rt_block *block, rt_input *events,
                int32_t count) {
    int32_t status = 0;
    for (int32_t k = 0; k < count; k++) {
        status = process(plugin, block);
        for (int side = 0; side < 2; side++)
            block->outputs->wide[side] += block->frames;
        events->count = 0;
    }
    return status;
}

/* reset(plugin), and flush(plugin, in, out), watched. */
void rt_reset(void (*reset)(const void *), const void *plugin) {
    watching = 1;
    reset(plugin);
    watching = 0;
}

void rt_flush(void (*flush)(const void *, const void *, const void *), const void *plugin, const void *in, const void *out) {
    watching = 1;
    flush(plugin, in, out);
    watching = 0;
}
