/* macOS. */
#define _DARWIN_C_SOURCE
#include <fcntl.h>
#include <limits.h>
#include <os/lock.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>
#include "system_kernels.h"
#include "system_posix.h"

_Static_assert(sizeof(os_unfair_lock) <= sizeof(system_guard), "fits into its room");

/* a lock of zeros is OS_UNFAIR_LOCK_INIT */
void system_lock(system_guard *guard) { os_unfair_lock_lock((os_unfair_lock *)(void *)guard); }
void system_unlock(system_guard *guard) { os_unfair_lock_unlock((os_unfair_lock *)(void *)guard); }

int32_t system_processors(void) {
    const long count = sysconf(_SC_NPROCESSORS_ONLN);
    return count < 1 ? 1 : (int32_t)count;
}

/* ---- tokens: bytes of a pipe, eight each ---- */

bool system_pipe(int ends[2]) {
    if (pipe(ends) != 0)
        return false;
    for (int k = 0; k < 2; k++)
        fcntl(ends[k], F_SETFD, FD_CLOEXEC);
    return true;
}

system_tokens system_tokens_new(void) {
    int ends[2];
    return system_pipe(ends) ? (system_tokens){ends[0], ends[1]} : (system_tokens){-1, -1};
}

void system_tokens_free(system_tokens tokens) {
    close(tokens.receive);
    close(tokens.send);
}

/* ---- the bank, which must not stand behind the end: the code's signature would not hold ---- */

bool system_bank_beside(const char *library, char *path, size_t room) {
    static const char programs[] = "/Contents/MacOS";
    const char *last = strrchr(library, '/');
    if (last == NULL)
        return false;
    size_t folder = (size_t)(last - library);
    const char *within = "";
    if (folder >= sizeof programs - 1 && memcmp(last - (sizeof programs - 1), programs, sizeof programs - 1) == 0) {
        folder -= strlen("/MacOS");
        within = "/Resources";
    }
    const int size = snprintf(path, room, "%.*s%s/bank.jawari", (int)folder, library, within);
    return size > 0 && (size_t)size < room;
}

/* ---- processes ---- */

const char *system_own_variable(const char *name) { return issetugid() ? NULL : getenv(name); }

bool system_alarm(int ends[2]) {
    if (!system_pipe(ends))
        return false;
    for (int k = 0; k < 2; k++)
        fcntl(ends[k], F_SETFL, O_NONBLOCK);
    return true;
}

bool system_spawn_apart(posix_spawn_file_actions_t *files, posix_spawnattr_t *how, short flags) {
    (void)files;
    return posix_spawnattr_setflags(how, (short)(flags | POSIX_SPAWN_SETSID | POSIX_SPAWN_CLOEXEC_DEFAULT)) == 0;
}

/* ---- what kernels call ---- */

int32_t jawari_system_clock_gettime(int32_t clock, int64_t time[2]) {
    struct timespec now;
    /* the steady one is that behind Python's clock */
    const clockid_t id = clock == CLOCK_OF_DAY      ? CLOCK_REALTIME
                         : clock == CLOCK_OF_THREAD ? CLOCK_THREAD_CPUTIME_ID
                                                    : CLOCK_UPTIME_RAW;
    const int wrong = clock_gettime(id, &now);
    time[0] = now.tv_sec;
    time[1] = now.tv_nsec;
    return wrong;
}

int32_t jawari_system_nanosleep(const int64_t time[2], int64_t left[2]) {
    (void)left;
    return nanosleep(&(struct timespec){(time_t)time[0], (long)time[1]}, NULL);
}

int32_t jawari_system_sched_yield(void) {
    system_yield();
    return 0;
}

int64_t jawari_system_read(int32_t from, void *bytes, int64_t size) { return read(from, bytes, (size_t)size); }
int64_t jawari_system_write(int32_t to, const void *bytes, int64_t size) { return write(to, bytes, (size_t)size); }
