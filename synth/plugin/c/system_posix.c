/* What Linux and macOS do alike. */
#define _GNU_SOURCE
#define _DARWIN_C_SOURCE
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <pthread.h>
#include <sched.h>
#include <signal.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>
#include "system.h"

_Static_assert(sizeof(pthread_t) <= sizeof(uintptr_t), "fits into system_thread.id");

void *system_alloc(size_t border, size_t size) {
    void *memory;
    return posix_memalign(&memory, border, size) == 0 ? memory : NULL;
}

void system_free(void *memory) { free(memory); }

const char *system_variable(const char *name) { return getenv(name); }

void system_say(const char *format, ...) {
    va_list given;
    va_start(given, format);
    vfprintf(stderr, format, given);
    va_end(given);
    fputc('\n', stderr);
}

/* ---- threads ---- */

static void *live(void *given) {
    system_thread *me = given;
    me->work(me->of);
    return NULL;
}

bool system_thread_start(system_thread *thread, void (*work)(void *), void *of, size_t stack, bool apart) {
    pthread_attr_t how;
    pthread_t id;
    sigset_t all, before;
    if (pthread_attr_init(&how) != 0)
        return false;
    if (stack > 0)
        pthread_attr_setstacksize(&how, stack);
    if (apart)
        pthread_attr_setinheritsched(&how, PTHREAD_EXPLICIT_SCHED);
    thread->work = work;
    thread->of = of;
    sigfillset(&all);
    pthread_sigmask(SIG_SETMASK, &all, &before);
    const bool started = pthread_create(&id, &how, live, thread) == 0;
    pthread_sigmask(SIG_SETMASK, &before, NULL);
    pthread_attr_destroy(&how);
    if (started)
        memcpy(&thread->id, &id, sizeof id);
    return started;
}

void system_thread_join(system_thread *thread) {
    pthread_t id;
    memcpy(&id, &thread->id, sizeof id);
    pthread_join(id, NULL);
}

void system_yield(void) { sched_yield(); }

bool system_tokens_send(system_tokens tokens) {
    const uint64_t one = 1;
    return write(tokens.send, &one, sizeof one) == (ssize_t)sizeof one;
}

/* ---- files ---- */

system_file system_open(const char *path) { return open(path, O_RDONLY | O_CLOEXEC); }

void system_close(system_file file) { close((int)file); }

int64_t system_size(system_file file) {
    struct stat about;
    return fstat((int)file, &about) == 0 && S_ISREG(about.st_mode) ? (int64_t)about.st_size : -1;
}

bool system_read_at(system_file file, uint64_t at, void *to, size_t size) {
    return pread((int)file, to, size, (off_t)at) == (ssize_t)size;
}

const uint8_t *system_map_file(system_file file, uint64_t at, size_t size, system_map *map) {
    const uint64_t page = (uint64_t)sysconf(_SC_PAGESIZE), begin = at / page * page;
    const size_t whole = (size_t)(at - begin) + size;
    void *pages = mmap(NULL, whole, PROT_READ, MAP_PRIVATE, (int)file, (off_t)begin);
    if (pages == MAP_FAILED)
        return NULL;
    *map = (system_map){pages, whole};
    return (const uint8_t *)pages + (at - begin);
}

void system_unmap(system_map *map) {
    if (map->pages != NULL)
        munmap(map->pages, map->size);
    *map = (system_map){0};
}

const char *system_reason(char text[SYSTEM_REASON]) {
    snprintf(text, SYSTEM_REASON, "%s", strerror(errno));
    return text;
}

char *system_own_path(void) {
    static const char here = 0; /* any object of the library's; of a function the standard knows no such pointer */
    Dl_info info;
    return dladdr(&here, &info) != 0 && info.dli_fname != NULL ? realpath(info.dli_fname, NULL) : NULL;
}
