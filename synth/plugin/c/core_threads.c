/* Threads that compute beside the caller's: workers of an engine's own, and those that a host lends.
 *
 * Both take instruments from the list that `engine.team` works off; which thread takes which changes no sample. The block's own
 * thread waits for nobody but those who have an instrument in hand: a helper that never comes keeps nothing up. */
#include "core.h"
#include "processor.h"

static void store(const jawari_engine *engine, int place, int64_t value) {
    __atomic_store_n(core_word(engine, place, 0), value, __ATOMIC_SEQ_CST);
}

static int64_t core_of(const jawari_engine *engine) { return (int64_t)(intptr_t)core_word(engine, PLACE_CORE, 0); }
static int64_t thread_of(const jawari_engine *engine, int32_t k) {
    return (int64_t)(intptr_t)(engine->thread[k].memory + engine->rate->thread_table);
}

static void live(void *given) {
    struct core_thread *me = given;
    const jawari_engine *engine = me->engine;
    engine->calls->attend(core_of(engine), thread_of(engine, (int32_t)(me - engine->thread)), engine->tokens.receive);
}

void core_start_workers(jawari_engine *engine) {
    if (engine->threads < 2)
        return;
    engine->tokens = system_tokens_new();
    if (engine->tokens.receive < 0)
        return;
    store(engine, PLACE_WAKE, engine->tokens.send);
    int32_t started = 0;
    for (int32_t k = 1; k < engine->threads; k++) {
        engine->thread[k].engine = engine;
        if (!system_thread_start(&engine->thread[k].worker, live, &engine->thread[k], 0, false))
            break;
        engine->thread[k].started = true;
        started++;
    }
    store(engine, PLACE_WORKERS, started);
}

void core_end_workers(jawari_engine *engine) {
    if (engine->tokens.receive < 0)
        return;
    store(engine, PLACE_WORKERS, 0);
    store(engine, PLACE_ENDING, 1);
    for (int32_t k = 1; k < engine->threads; k++)
        while (engine->thread[k].started && !system_tokens_send(engine->tokens)) {
        }
    for (int32_t k = 1; k < engine->threads; k++)
        if (engine->thread[k].started)
            system_thread_join(&engine->thread[k].worker);
    system_tokens_free(engine->tokens);
    engine->tokens = (system_tokens){-1, -1};
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
            system_yield();
            idle = 0;
        } else
            processor_pause();
    }
    engine->calls->restore(control);
    atomic_store(&me->busy, false);
}
