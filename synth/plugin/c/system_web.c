/* WebAssembly: one thread, no files, no clock. It asks nothing of whoever runs it: the module has no import. */
#define _GNU_SOURCE
#include <stdlib.h>
#include "jawari.h"
#include "system.h"
#include "system_kernels.h"

void *system_alloc(size_t border, size_t size) {
    void *memory;
    return posix_memalign(&memory, border, size) == 0 ? memory : NULL;
}

void system_free(void *memory) { free(memory); }

/* Memory for who runs the module: for a bank, events, sound. */
JAWARI_API void *jawari_alloc(size_t size);
JAWARI_API void jawari_free(void *memory);
void *jawari_alloc(size_t size) { return system_alloc(JAWARI_BORDER, size); }
void jawari_free(void *memory) { system_free(memory); }

const char *system_variable(const char *name) {
    (void)name;
    return NULL;
}

void system_say(const char *format, ...) { (void)format; }

/* ---- one thread ---- */

void system_lock(system_guard *guard) { (void)guard; }
void system_unlock(system_guard *guard) { (void)guard; }

bool system_thread_start(system_thread *thread, void (*work)(void *), void *of, size_t stack, bool apart) {
    (void)thread, (void)work, (void)of, (void)stack, (void)apart;
    return false;
}

void system_thread_join(system_thread *thread) { (void)thread; }

int32_t system_processors(void) { return 1; }
void system_yield(void) {}

system_tokens system_tokens_new(void) { return (system_tokens){-1, -1}; }
void system_tokens_free(system_tokens tokens) { (void)tokens; }
bool system_tokens_send(system_tokens tokens) {
    (void)tokens;
    return true;
}

/* ---- no files: banks are bytes (bank_alone.c) ---- */

void system_unmap(system_map *map) { (void)map; }

/* ---- what kernels of threads and of live sessions name; with one thread nobody calls it ---- */

int32_t jawari_system_clock_gettime(int32_t clock, int64_t time[2]) {
    (void)clock;
    time[0] = time[1] = 0;
    return -1;
}

int32_t jawari_system_nanosleep(const int64_t time[2], int64_t left[2]) {
    (void)time, (void)left;
    return 0;
}

int32_t jawari_system_sched_yield(void) { return 0; }

int64_t jawari_system_read(int32_t from, void *bytes, int64_t size) {
    (void)from, (void)bytes, (void)size;
    return -1;
}

int64_t jawari_system_write(int32_t to, const void *bytes, int64_t size) {
    (void)to, (void)bytes, (void)size;
    return -1;
}
