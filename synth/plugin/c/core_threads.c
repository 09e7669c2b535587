/* Threads that compute beside the caller's: workers of an engine's own, and those that a host lends.
 *
 * Both take instruments from the list that `engine.team` works off; which thread takes which changes no sample. The block's own
 * thread waits for nobody but those who have an instrument in hand: a helper that never comes keeps nothing up. */
#define _GNU_SOURCE
#include <sched.h>
#include <signal.h>
#include <sys/eventfd.h>
#include <unistd.h>
#include "core.h"

static void store(const jawari_engine *engine, int place, int64_t value) {
    __atomic_store_n(core_word(engine, place, 0), value, __ATOMIC_SEQ_CST);
}

static int64_t core_of(const jawari_engine *engine) { return (int64_t)(intptr_t)core_word(engine, PLACE_CORE, 0); }
static int64_t thread_of(const jawari_engine *engine, int32_t k) {
    return (int64_t)(intptr_t)(engine->thread[k].memory + engine->rate->thread_table);
}

static void *live(void *given) {
    struct core_thread *me = given;
    const jawari_engine *engine = me->engine;
    engine->calls->attend(core_of(engine), thread_of(engine, (int32_t)(me - engine->thread)), engine->token);
    return NULL;
}

int32_t core_processors(void) {
    cpu_set_t mine;
    const long count = sched_getaffinity(0, sizeof mine, &mine) == 0 ? CPU_COUNT(&mine) : sysconf(_SC_NPROCESSORS_ONLN);
    return count < 1 ? 1 : count > CORE_MOST_THREADS ? CORE_MOST_THREADS : (int32_t)count;
}

void core_start_workers(jawari_engine *engine) {
    if (engine->threads < 2)
        return;
    engine->token = eventfd(0, EFD_SEMAPHORE | EFD_CLOEXEC);
    if (engine->token < 0)
        return;
    store(engine, PLACE_WAKE, engine->token);
    /* signals are the host's */
    sigset_t all, before;
    sigfillset(&all);
    pthread_sigmask(SIG_SETMASK, &all, &before);
    int32_t started = 0;
    for (int32_t k = 1; k < engine->threads; k++) {
        engine->thread[k].engine = engine;
        if (pthread_create(&engine->thread[k].id, NULL, live, &engine->thread[k]) != 0)
            break;
        engine->thread[k].started = true;
        started++;
    }
    pthread_sigmask(SIG_SETMASK, &before, NULL);
    store(engine, PLACE_WORKERS, started);
}

void core_end_workers(jawari_engine *engine) {
    if (engine->token < 0)
        return;
    store(engine, PLACE_WORKERS, 0);
    store(engine, PLACE_ENDING, 1);
    for (int32_t k = 1; k < engine->threads; k++) {
        const uint64_t one = 1;
        while (engine->thread[k].started && write(engine->token, &one, sizeof one) != (ssize_t)sizeof one) {
        }
    }
    for (int32_t k = 1; k < engine->threads; k++)
        if (engine->thread[k].started)
            pthread_join(engine->thread[k].id, NULL);
    close(engine->token);
    engine->token = -1;
}

void jawari_lend(jawari_engine *engine) {
    /* helpers work with the memories of the workers: these have to be gone */
    core_end_workers(engine);
    store(engine, PLACE_ENDING, 0);
    store(engine, PLACE_SLEEPING, 0);
    store(engine, PLACE_WORKERS, engine->threads - 1);
    atomic_store(&engine->lent, true);
}

void jawari_help(jawari_engine *engine, int32_t k) {
    if (k < 1 || k >= engine->threads || !atomic_load(&engine->lent))
        return;
    struct core_thread *me = &engine->thread[k];
    /* one thread at a time works with one memory */
    if (atomic_exchange(&me->busy, true))
        return;
    const int64_t control = engine->calls->enable_ftz();
    /* where there are fewer processors than threads, the block's own thread must get one */
    enum { LOOKS = 1000 };
    for (int32_t idle = 0; atomic_load(&engine->working);) {
        if (engine->calls->take(core_of(engine), thread_of(engine, k)) != 0)
            idle = 0;
        else if (++idle >= LOOKS) {
            sched_yield();
            idle = 0;
        } else {
#if defined(__x86_64__)
            __builtin_ia32_pause();
#elif defined(__aarch64__)
            __asm__ volatile("yield");
#endif
        }
    }
    engine->calls->restore(control);
    atomic_store(&me->busy, false);
}
