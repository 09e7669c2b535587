/* Linux. Kernels call its C library themselves. */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <pthread.h>
#include <sched.h>
#include <stdlib.h>
#include <string.h>
#include <sys/eventfd.h>
#include <unistd.h>
#include <fcntl.h>
#include "system_posix.h"

_Static_assert(sizeof(pthread_mutex_t) <= sizeof(system_guard), "fits into its room");

/* a mutex of zeros is PTHREAD_MUTEX_INITIALIZER */
void system_lock(system_guard *guard) { pthread_mutex_lock((pthread_mutex_t *)(void *)guard); }
void system_unlock(system_guard *guard) { pthread_mutex_unlock((pthread_mutex_t *)(void *)guard); }

int32_t system_processors(void) {
    cpu_set_t mine;
    const long count = sched_getaffinity(0, sizeof mine, &mine) == 0 ? CPU_COUNT(&mine) : sysconf(_SC_NPROCESSORS_ONLN);
    return count < 1 ? 1 : (int32_t)count;
}

system_tokens system_tokens_new(void) {
    const int token = eventfd(0, EFD_SEMAPHORE | EFD_CLOEXEC);
    return (system_tokens){token, token};
}

void system_tokens_free(system_tokens tokens) { close(tokens.receive); }

bool system_bank_beside(const char *library, char *path, size_t room) {
    (void)library, (void)path, (void)room;
    return false;
}

/* ---- processes ---- */

const char *system_own_variable(const char *name) { return secure_getenv(name); }

bool system_pipe(int ends[2]) { return pipe2(ends, O_CLOEXEC) == 0; }

bool system_alarm(int ends[2]) {
    ends[0] = ends[1] = eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK);
    return ends[0] >= 0;
}

bool system_spawn_apart(posix_spawn_file_actions_t *files, posix_spawnattr_t *how, short flags) {
    /* of C libraries that have it: what a host has left open to its children, it closes itself else (rebuild.py) */
    int (*close_from)(posix_spawn_file_actions_t *, int);
    void *found = dlsym(RTLD_DEFAULT, "posix_spawn_file_actions_addclosefrom_np");
    memcpy(&close_from, &found, sizeof close_from);
    const int wrong = found ? close_from(files, 3) : 0;
#ifdef POSIX_SPAWN_SETSID
    const short apart = POSIX_SPAWN_SETSID;
#else
    const short apart = POSIX_SPAWN_SETPGROUP;
#endif
    return (wrong | posix_spawnattr_setflags(how, (short)(flags | apart))) == 0;
}
