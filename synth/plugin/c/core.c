/* Engines: memory as a bank has it, addresses put in, and blocks of sound. */
#include <math.h>
#include <string.h>
#include "core.h"

/* as `synth.midi.events.EVENT`: kernels are handed events as they are */
_Static_assert(sizeof(jawari_event) == 32 && offsetof(jawari_event, value) == 24, "as EVENT");

/* what sounded fades over so many seconds at a reset */
static const double FADE_S = 0.003;

/* ---- made and let go ---- */

/* A region of an engine: what it begins with, and zeros. */
static uint8_t *region(const uint8_t *stored, uint64_t size_stored, uint64_t size) {
    uint8_t *memory = system_alloc(4096, (size_t)size + 64);
    if (memory == NULL)
        return NULL;
    memcpy(memory, stored, (size_t)size_stored);
    memset(memory + size_stored, 0, (size_t)(size + 64 - size_stored));
    return memory;
}

/* Reads a byte of every page: what is mapped from a file is there before the audio thread wants it. */
static void touch(const uint8_t *bytes, uint64_t size) {
    enum { PAGE = 4096 };
    for (uint64_t at = 0; at < size; at += PAGE)
        (void)*(const volatile uint8_t *)(bytes + at);
}

/* Puts the addresses into a region, the core or a thread's memory. */
static void relocate(const jawari_engine *engine, uint32_t region_number, uint8_t *memory, const uint8_t *thread) {
    const struct bank_rate *r = engine->rate;
    const struct bank_relocation *relocation = (const void *)(engine->block + r->relocations_at);
    for (uint64_t k = 0; k < r->relocations; k++) {
        const struct bank_relocation *x = &relocation[k];
        if (x->region != region_number)
            continue;
        uint64_t value = 0;
        switch (x->to) {
        case TO_CONSTANT:
            value = (uint64_t)(uintptr_t)(engine->block + r->constants_at + x->target);
            break;
        case TO_CORE:
            value = (uint64_t)(uintptr_t)(engine->memory + x->target);
            break;
        case TO_THREAD:
            value = (uint64_t)(uintptr_t)(thread + x->target);
            break;
        case TO_FUNCTION:
            value = (uint64_t)(uintptr_t)engine->bank->function[x->target];
            break;
        default:
            break;
        }
        memcpy(memory + x->word, &value, sizeof value);
    }
}

jawari_engine *jawari_create(jawari_bank *bank, double rate_hz, int32_t threads, char *why) {
    if (bank == NULL) {
        core_say(why, "there is no bank; open one first");
        return NULL;
    }
    const struct core_calls *calls = core_kernels(why);
    const struct bank_rate *r = calls == NULL ? NULL : bank_block(bank, rate_hz, why);
    if (r == NULL)
        return NULL;
    jawari_engine *engine = system_alloc(64, sizeof *engine);
    if (engine == NULL) {
        core_say(why, "no memory for an engine; close other programs");
        return NULL;
    }
    memset(engine, 0, sizeof *engine);
    engine->bank = jawari_hold(bank);
    engine->rate = r;
    engine->calls = calls;
    engine->block = bank->data + r->at;
    engine->tokens = (system_tokens){-1, -1};
    const int32_t strings = (int32_t)r->places[PLACE_AWAKE].count;
    /* more threads than processors, and the block's own would wait for its turn */
    const int32_t most = system_processors(), processors = most > CORE_MOST_THREADS ? CORE_MOST_THREADS : most;
    engine->threads = threads < 1 ? 1 : threads > processors ? processors : threads;
    if (engine->threads > strings)
        engine->threads = strings;
    engine->fade_frames = (int32_t)ceil(FADE_S * r->rate_hz);
    /* written here for the first time, as all that the audio thread works with */
    engine->fade = (void *)region(engine->block, 0, (uint64_t)engine->fade_frames * 2 * sizeof *engine->fade);
    engine->memory = region(engine->block + r->core_at, r->core_stored, r->core);
    bool enough = engine->fade != NULL && engine->memory != NULL;
    for (int32_t k = 0; k < engine->threads && enough; k++) {
        engine->thread[k].memory = region(engine->block + r->thread_at, r->thread_stored, r->thread);
        enough = engine->thread[k].memory != NULL;
        if (enough)
            relocate(engine, TO_THREAD, engine->thread[k].memory, engine->thread[k].memory);
    }
    if (!enough) {
        core_say(why, "no memory for an engine of %.1f MB; close other programs", 1e-6 * (double)(r->core + r->thread));
        jawari_destroy(engine);
        return NULL;
    }
    relocate(engine, TO_CORE, engine->memory, engine->thread[0].memory);
    touch(engine->block + r->constants_at, r->constants);
    core_start_workers(engine);
    return engine;
}

void jawari_destroy(jawari_engine *engine) {
    if (engine == NULL)
        return;
    core_end_workers(engine);
    for (int32_t k = 0; k < CORE_MOST_THREADS; k++)
        system_free(engine->thread[k].memory);
    system_free(engine->memory);
    system_free(engine->fade);
    jawari_close(engine->bank);
    system_free(engine);
}

/* ---- blocks ---- */

static int64_t table_of(const jawari_engine *engine) { return (int64_t)(intptr_t)core_word(engine, PLACE_CORE, 0); }
static int64_t thread_of(const jawari_engine *engine, int32_t k) {
    return (int64_t)(intptr_t)(engine->thread[k].memory + engine->rate->thread_table);
}

/* Events that are there at once, and frames of sound into engine->mix. */
static void run(jawari_engine *engine, int32_t count, int32_t frames) {
    engine->calls->process(table_of(engine), thread_of(engine, 0), (int64_t)(intptr_t)engine->events, count,
                           (int64_t)(intptr_t)engine->mix, frames, 2, 0, 0, 0, 2);
}

/* Whether the engine knows what an event says. */
static bool is_event(const jawari_event *x) { return x->kind >= JAWARI_NOTE_ON && x->kind <= JAWARI_TUNING; }

/* Hands a block's events over: the queue takes them with the frames at which they are to be heard. */
static void queue(jawari_engine *engine, const jawari_event *events, int32_t count, int32_t frames) {
    int64_t last = 0;
    int32_t held = 0;
    for (int32_t k = 0; k < count; k++) {
        if (!is_event(&events[k]))
            continue;
        jawari_event *x = &engine->events[held];
        *x = events[k];
        if (x->frame >= frames)
            x->frame = frames - 1;
        if (x->frame < last)
            x->frame = last;
        last = x->frame;
        if (++held == CORE_EVENTS) {
            run(engine, held, 0);
            held = 0;
        }
        engine->touched = true;
    }
    if (held > 0)
        run(engine, held, 0);
}

static bool any(const jawari_engine *engine, int place, int64_t than) {
    for (uint64_t k = 0; k < engine->rate->places[place].count; k++)
        if (*core_word(engine, place, k) != than)
            return true;
    return false;
}

/* The next frames, at most CORE_CHUNK, into engine->mix, with what still fades. */
static void next(jawari_engine *engine, int32_t frames) {
    run(engine, 0, frames);
    for (int32_t i = 0; i < frames && engine->fade_at < engine->fade_end; i++, engine->fade_at++) {
        engine->mix[2 * i] += engine->fade[2 * engine->fade_at];
        engine->mix[2 * i + 1] += engine->fade[2 * engine->fade_at + 1];
    }
    if (!engine->touched)
        return;
    if (any(engine, PLACE_AWAKE, 0) || *core_word(engine, PLACE_PENDING, 0) != 0 || any(engine, PLACE_STILL, 1) ||
        engine->fade_at < engine->fade_end)
        engine->quiet = 0;
    else if ((engine->quiet += frames) > engine->rate->latency)
        engine->touched = false;
}

static int32_t chunk(int32_t left) { return left < CORE_CHUNK ? left : CORE_CHUNK; }

static void begin(jawari_engine *engine, const jawari_event *events, int32_t count, int32_t frames) {
    atomic_store(&engine->working, true);
    if (events != NULL)
        queue(engine, events, count, frames);
}

void jawari_process(jawari_engine *engine, const jawari_event *events, int32_t count, int32_t frames, double *left,
                    double *right) {
    begin(engine, events, count, frames);
    for (int32_t done = 0, n; done < frames; done += n) {
        n = chunk(frames - done);
        next(engine, n);
        for (int32_t i = 0; i < n; i++) {
            left[done + i] = engine->mix[2 * i];
            right[done + i] = engine->mix[2 * i + 1];
        }
    }
    atomic_store(&engine->working, false);
}

void jawari_process_float(jawari_engine *engine, const jawari_event *events, int32_t count, int32_t frames, float *left,
                          float *right) {
    begin(engine, events, count, frames);
    for (int32_t done = 0, n; done < frames; done += n) {
        n = chunk(frames - done);
        next(engine, n);
        for (int32_t i = 0; i < n; i++) {
            left[done + i] = (float)engine->mix[2 * i];
            right[done + i] = (float)engine->mix[2 * i + 1];
        }
    }
    atomic_store(&engine->working, false);
}

/* Nothing sounds, everything is as when it was made; what fades goes on to. */
static void begin_anew(jawari_engine *engine) {
    const struct bank_rate *r = engine->rate;
    const uint64_t stored = r->core_stored < r->sounding       ? r->sounding
                            : r->core_stored > r->sounding_end ? r->sounding_end
                                                               : r->core_stored;
    memcpy(engine->memory + r->sounding, engine->block + r->core_at + r->sounding, (size_t)(stored - r->sounding));
    memset(engine->memory + stored, 0, (size_t)(r->sounding_end - stored));
    *core_word(engine, PLACE_UNTIL, 0) = 0;
    engine->quiet = 0;
}

/* What sounds begins to fade; the next blocks add that to what they compute. */
static void fade_out(jawari_engine *engine) {
    if (!engine->touched)
        return;
    /* what would have come, ever quieter; with what was fading already */
    const int32_t frames = engine->fade_frames;
    double *into = engine->fade;
    int32_t left = engine->fade_end - engine->fade_at;
    memmove(into, into + 2 * engine->fade_at, (size_t)left * 2 * sizeof *into);
    memset(into + 2 * left, 0, (size_t)(frames - left) * 2 * sizeof *into);
    for (int32_t done = 0, n; done < frames; done += n) {
        n = chunk(frames - done);
        run(engine, 0, n);
        for (int32_t i = 0; i < n; i++) {
            const double share = 1.0 - (double)(done + i + 1) / (double)frames;
            for (int32_t side = 0; side < 2; side++) {
                double *x = &into[2 * (done + i) + side];
                *x = (*x + engine->mix[2 * i + side]) * share;
            }
        }
    }
    engine->fade_at = 0;
    engine->fade_end = frames;
}

void jawari_reset(jawari_engine *engine) {
    fade_out(engine);
    begin_anew(engine);
}

/* ---- looked at ---- */

double jawari_rate(const jawari_engine *engine) { return engine->rate->rate_hz; }
int32_t jawari_threads(const jawari_engine *engine) { return engine->threads; }
int32_t jawari_latency(const jawari_engine *engine) { return (int32_t)engine->rate->latency; }
int64_t jawari_tail(const jawari_engine *engine) { return engine->rate->tail; }

static int64_t sum(const jawari_engine *engine, int place) {
    int64_t total = 0;
    for (uint64_t k = 0; k < engine->rate->places[place].count; k++)
        total += *core_word(engine, place, k);
    return total;
}

int32_t jawari_voices(const jawari_engine *engine) {
    return (int32_t)(sum(engine, PLACE_AWAKE) - sum(engine, PLACE_IDLE));
}
int32_t jawari_silent(const jawari_engine *engine) { return !engine->touched; }

static double number(const int64_t *word) {
    double value;
    memcpy(&value, word, sizeof value);
    return value;
}

double jawari_value(const jawari_engine *engine, int32_t part, int32_t index) {
    const struct bank_place *p = &engine->rate->places[PLACE_PARAMETERS];
    if (part < 0 || (uint64_t)part >= p->count || index < 0 || (uint64_t)index >= p->stride / 8)
        return NAN;
    return number(core_word(engine, PLACE_PARAMETERS, (uint64_t)part) + index);
}

int32_t jawari_program(const jawari_engine *engine, int32_t channel) {
    return channel < 0 || channel > 15 ? -1 : (int32_t)*core_word(engine, PLACE_PROGRAMS, (uint64_t)channel);
}

double jawari_pitch(const jawari_engine *engine, int32_t key) {
    if (key < 0 || key > 127)
        return NAN;
    const uint8_t *pitch = engine->block + engine->rate->constants_at + engine->rate->pitch;
    return number((const int64_t *)(const void *)(pitch + 8 * key));
}

int32_t jawari_sounding(const jawari_engine *engine, int32_t channel, int32_t note) {
    for (uint64_t k = 0; k < engine->rate->places[PLACE_AWAKE].count; k++)
        if (*core_word(engine, PLACE_AWAKE, k) != 0 && *core_word(engine, PLACE_NOTE, k) == note &&
            *core_word(engine, PLACE_CHANNEL, k) == channel)
            return 1;
    return 0;
}

void jawari_report_of(const jawari_engine *engine, jawari_report *report) {
    report->peak = number(core_word(engine, PLACE_PEAK, 0));
    report->notes = *core_word(engine, PLACE_NOTES, 0);
    report->unplayed = sum(engine, PLACE_UNPLAYED);
    report->stolen = *core_word(engine, PLACE_STOLEN, 0);
    report->dropped = *core_word(engine, PLACE_DROPPED, 0);
    report->silenced = *core_word(engine, PLACE_SILENCED, 0) + sum(engine, PLACE_SILENCED_STRINGS) +
                       sum(engine, PLACE_SILENCED_PARTS);
}
