/* system.h: what the C part needs of the system that it runs on. Private to it.
 *
 * Each system has a file, system_NAME.c, with all that differs; Linux and macOS share system_posix.c. Which files are compiled
 * synth/plugin/c_sources.py tells: no other source asks for the system.
 */
#ifndef JAWARI_SYSTEM_H
#define JAWARI_SYSTEM_H

#include <stdatomic.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

/* ---- memory ---- */

/* Memory on a border, a power of two; NULL: there is none. It is freed by system_free only; NULL is nothing. */
void *system_alloc(size_t border, size_t size);
void system_free(void *memory);

/* ---- environment ---- */

/* A variable of the environment; NULL: it is not set, or the system has none. */
const char *system_variable(const char *name);
/* A line on the error output, where there is one. */
#if defined(__GNUC__)
__attribute__((format(printf, 1, 2)))
#endif
void system_say(const char *format, ...);

/* ---- guards ---- */

/* A lock that one thread holds; one of zeros is free. It needs no end. */
typedef struct system_guard {
    uint64_t room[8];
} system_guard;
void system_lock(system_guard *guard);
void system_unlock(system_guard *guard);

/* Work that is done once, by the first thread that comes; the others wait. One of zeros is yet to be done. */
typedef struct system_once {
    system_guard guard;
    atomic_bool done;
} system_once;
static inline void system_do_once(system_once *once, void (*work)(void)) {
    if (atomic_load(&once->done))
        return;
    system_lock(&once->guard);
    if (!atomic_load(&once->done)) {
        work();
        atomic_store(&once->done, true);
    }
    system_unlock(&once->guard);
}

/* ---- threads ---- */

/* A thread; it must stay where it is until it was joined. */
typedef struct system_thread {
    void (*work)(void *);
    void *of;
    uintptr_t id;
} system_thread;
/* Starts a thread that hears no signals of the host's. stack: in bytes, 0: what the system gives. apart: its priority is that of
 * any program, not that of the thread which starts it. False: there is none to be had. */
bool system_thread_start(system_thread *thread, void (*work)(void *), void *of, size_t stack, bool apart);
void system_thread_join(system_thread *thread);

/* Processors that the calling thread may use, and with it those that it starts; at least 1. */
int32_t system_processors(void);
/* Another thread may have this processor. */
void system_yield(void);

/* What wakes workers: each token that is sent lets one of them, which sleep as they receive, go on. */
typedef struct system_tokens {
    int32_t receive, send; /* what kernels are handed; below 0: there are none */
} system_tokens;
system_tokens system_tokens_new(void);
void system_tokens_free(system_tokens tokens);
bool system_tokens_send(system_tokens tokens);

/* ---- files ---- */

/* An open file; below 0: there is none. Paths are UTF-8. */
typedef intptr_t system_file;
system_file system_open(const char *path);
void system_close(system_file file);
/* Its size in bytes, −1: it is no file with contents of its own. */
int64_t system_size(system_file file);
bool system_read_at(system_file file, uint64_t at, void *to, size_t size);

/* Bytes of a file as memory that is read only; of zeros: there are none. */
typedef struct system_map {
    void *pages;
    size_t size;
} system_map;
/* NULL: it cannot be done. */
const uint8_t *system_map_file(system_file file, uint64_t at, size_t size, system_map *map);
void system_unmap(system_map *map);

/* Why the last of these functions on files has failed. */
enum { SYSTEM_REASON = 510 };
const char *system_reason(char text[SYSTEM_REASON]);

/* The path from the root on of the file from which this very code was loaded; NULL: it is not known. To be freed with free(). */
char *system_own_path(void);
/* Where the bank of a library lies on systems whose libraries can have nothing behind their end; false: it lies in the library. */
bool system_bank_beside(const char *library, char *path, size_t room);

#endif
