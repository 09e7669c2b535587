/* plugin_rebuild.c: an instance's wishes for another setup, and how it goes over to it; see plugin_rebuild.h. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "plugin_rebuild.h"

/* so many blocks are waited for one in which no event is on its way; what sounds fades over so many seconds */
enum { MOST_WAITED = 200 };
static const double FADE_S = 0.02;

static void store(_Atomic uint64_t *to, double value) {
    uint64_t bits;
    memcpy(&bits, &value, sizeof bits);
    atomic_store_explicit(to, bits, memory_order_relaxed);
}

double plugin_played(const plugin *p, uint32_t k) {
    if (!plugin_is_setup(p, k))
        return plugin_value(p, k);
    const uint64_t bits = atomic_load_explicit(&p->rebuild->played[k - p->of_presets], memory_order_relaxed);
    double value;
    memcpy(&value, &bits, sizeof value);
    return value;
}

bool plugin_rebuild_possible(const plugin *p) { return p->rebuild->there; }

void plugin_rebuild_wish(plugin *p) { plugin_wake(p->rebuild); }

void plugin_when_changed(plugin *p, void (*call)(void *), void *whose) {
    p->rebuild->changed = call;
    p->rebuild->whose = whose;
}

/* ---- engines ---- */

static bool fits(const jawari_bank *bank, const jawari_bank *own) {
    if (memcmp(jawari_bank_uid(bank), jawari_bank_uid(own), 16) != 0 || jawari_presets(bank) != jawari_presets(own) ||
        jawari_parameters(bank) != jawari_parameters(own) || jawari_strings(bank) != jawari_strings(own))
        return false;
    for (int32_t k = 0; k < jawari_presets(own); k++)
        if (strcmp(jawari_preset_of(bank, k)->id, jawari_preset_of(own, k)->id) != 0)
            return false;
    return true;
}

/* A bank by its key, to be closed; NULL with `why`. */
static jawari_bank *bank_of(const plugin *p, const char *key, char *why) {
    if (!*key)
        return jawari_hold(p->bank);
    char path[PYTHON_PATH + 160];
    plugin_maker_path(p, key, path, sizeof path);
    if (!plugin_bank_trusted(path)) {
        snprintf(why, JAWARI_WHY, "there is no bank of it in the cache, or it is not the user's alone");
        return NULL;
    }
    jawari_bank *bank = jawari_open(path, why);
    if (bank && !fits(bank, p->bank)) {
        snprintf(why, JAWARI_WHY, "the bank of it in the cache is another plugin's");
        jawari_close(bank);
        return NULL;
    }
    return bank;
}

/* Of a bank by its key; NULL with `why`. */
static jawari_engine *engine_of(const plugin *p, const char *key, char *why) {
    const plugin_rebuild *r = p->rebuild;
    jawari_bank *bank = bank_of(p, key, why);
    if (!bank)
        return NULL;
    jawari_engine *engine = jawari_create(bank, r->rate_hz, r->threads, why);
    jawari_close(bank);
    if (engine && *key && jawari_latency(engine) != r->latency) {
        snprintf(why, JAWARI_WHY, "its latency is another");
        jawari_destroy(engine);
        return NULL;
    }
    if (engine && r->host_threads)
        jawari_lend(engine);
    return engine;
}

static void free_plugin_handovers(plugin_handover *h) {
    while (h) {
        plugin_handover *next = h->next;
        jawari_destroy(h->engine);
        free(h);
        h = next;
    }
}

void plugin_sweep_engines(const plugin *p) { free_plugin_handovers(atomic_exchange(&p->rebuild->gone, NULL)); }

/* Hands an engine of a wish to the audio thread, if there is a bank of it; false with `why`. With r->guard. */
bool plugin_go_over(plugin *p, const plugin_wish *w, char *why) {
    plugin_rebuild *r = p->rebuild;
    if (strcmp(w->key, r->key) != 0) {
        jawari_engine *engine = engine_of(p, w->key, why);
        plugin_handover *h = engine ? calloc(1, sizeof *h + p->setups * sizeof *h->values) : NULL;
        if (!h) {
            if (engine)
                snprintf(why, JAWARI_WHY, "there is not enough memory for another setup");
            jawari_destroy(engine);
            return false;
        }
        h->engine = engine;
        memcpy(h->values, w->values, p->setups * sizeof *h->values);
        free_plugin_handovers(atomic_exchange(&r->arriving, h)); /* one that the audio thread has never seen */
        memcpy(r->key, w->key, sizeof r->key);
    }
    r->state = SETUP_PLAYED;
    return true;
}

/* ---- life ---- */

bool plugin_rebuild_new(plugin *p) {
    plugin_rebuild *r = p->rebuild = calloc(1, sizeof *r);
    if (!r)
        return false;
    r->played = calloc(p->setups + 1u, sizeof *r->played);
    if (!r->played) {
        free(r);
        p->rebuild = NULL;
        return false;
    }
    for (uint32_t j = 0; j < p->setups; j++)
        store(&r->played[j], p->parameters[p->of_presets + j].initial);
    r->there = p->setups && plugin_maker_new(r);
    return true;
}

void plugin_rebuild_free(plugin *p) {
    plugin_rebuild *r = p->rebuild;
    if (!r)
        return;
    plugin_maker_free(r);
    free(r->played);
    free(r);
    p->rebuild = NULL;
}

jawari_engine *plugin_rebuild_create(plugin *p, double rate_hz, int32_t threads, bool host_threads, char *why) {
    plugin_rebuild *r = p->rebuild;
    r->rate_hz = rate_hz;
    r->threads = threads;
    r->host_threads = host_threads;
    r->fade_frames = (int32_t)ceil(FADE_S * rate_hz);
    plugin_wish *w = plugin_wish_of(p, rate_hz);
    char missing[JAWARI_WHY];
    const bool other = w && r->there && *w->key;
    if (other)
        r->latency = plugin_latency(p); /* the same for all rates and setups */
    jawari_engine *engine = other ? engine_of(p, w->key, missing) : NULL;
    const bool found = engine != NULL;
    if (!found)
        engine = engine_of(p, "", why);
    r->latency = engine ? jawari_latency(engine) : 0;
    plugin_copy_text(r->key, sizeof r->key, found ? w->key : "");
    r->state = other && !found ? SETUP_PREPARED : SETUP_PLAYED;
    for (uint32_t j = 0; j < p->setups; j++)
        store(&r->played[j], found ? w->values[j] : p->parameters[p->of_presets + j].initial);
    free(w);
    return engine;
}

void plugin_rebuild_begin(plugin *p) {
    plugin_rebuild *r = p->rebuild;
    atomic_store(&r->ending, false);
    r->running = r->there && plugin_maker_start(p);
}

void plugin_rebuild_end(plugin *p) {
    plugin_rebuild *r = p->rebuild;
    if (!r)
        return;
    if (r->running) {
        atomic_store(&r->ending, true);
        plugin_wake(r);
        system_thread_join(&r->thread);
        r->running = false;
    }
    free_plugin_handovers(atomic_exchange(&r->arriving, NULL));
    free_plugin_handovers(atomic_exchange(&r->gone, NULL));
    free_plugin_handovers(r->leaving);
    r->leaving = NULL;
}

void plugin_rebuild_loaded(plugin *p) {
    plugin_rebuild *r = p->rebuild;
    plugin_wish *w = plugin_wish_of(p, r->rate_hz);
    if (!w)
        return;
    char why[JAWARI_WHY];
    system_lock(&r->guard);
    if (r->there && p->engine)
        plugin_go_over(p, w, why); /* where that is not there yet, the thread sees to it */
    else if (!r->there && w->count)
        snprintf(r->remark, sizeof r->remark,
                 "the song was saved with another setup (%s%s); this plays as compiled: Python with jawari is needed for it, install "
                 "that and export again",
                 w->settings[0], w->count > 1 ? ", …" : "");
    system_unlock(&r->guard);
    free(w);
    plugin_wake(r);
}

/* ---- texts ---- */

bool plugin_remark(plugin *p, char *why) {
    plugin_rebuild *r = p->rebuild;
    system_lock(&r->guard);
    const bool any = *r->remark != 0;
    if (any)
        plugin_copy_text(why, JAWARI_WHY, r->remark);
    *r->remark = 0;
    system_unlock(&r->guard);
    return any;
}

void plugin_rebuild_text(const plugin *p, uint32_t k, double value, char *text, size_t room) {
    plugin_rebuild *r = p->rebuild;
    const char *unit = p->parameters[k].unit;
    const double played = plugin_played(p, k);
    const bool now = plugin_same_number(value, plugin_value(p, k)), other = now && !plugin_same_number(value, played);
    char number[48], plays[48], whole[JAWARI_WHY + 256];
    plugin_write_number(number, sizeof number, value);
    plugin_write_number(plays, sizeof plays, played);
    int n = snprintf(whole, sizeof whole, "%s%s%s", number, *unit ? " " : "", unit);
    char *more = whole + n;
    const size_t left = sizeof whole - (size_t)n;
    system_lock(&r->guard);
    if (!r->there && other)
        snprintf(more, left, " (not played, but %s: needs Python with jawari; install it and export again)", plays);
    else if (!r->there)
        snprintf(more, left, " (fixed: needs Python with jawari to change; export again)");
    else if (other && p->engine && r->state == SETUP_FAILED)
        snprintf(more, left, " (%s plays: %s)", plays, r->why);
    else if (other && p->engine)
        snprintf(more, left, " (%s plays, this is being made)", plays);
    system_unlock(&r->guard);
    plugin_copy_text(text, room, whole);
}

/* ---- audio thread ---- */

static void push(_Atomic(plugin_handover *) *list, plugin_handover *h) {
    h->next = atomic_load(list);
    while (!atomic_compare_exchange_weak(list, &h->next, h)) {
    }
}

void plugin_rebuild_take(plugin *p) {
    plugin_rebuild *r = p->rebuild;
    if (!atomic_load_explicit(&r->arriving, memory_order_relaxed))
        return;
    const bool waiting = jawari_waiting(p->engine);
    if (r->leaving || (waiting && ++r->waited < MOST_WAITED))
        return;
    r->waited = 0;
    plugin_handover *h = atomic_exchange(&r->arriving, NULL);
    if (!h)
        return;
    jawari_engine *before = p->engine;
    jawari_follow(h->engine, before);
    for (uint32_t k = 0; waiting && k < p->of_presets; k++)
        p->sent[k] = (double)NAN; /* the last of these may still have been on its way: all are told again */
    for (uint32_t j = 0; j < p->setups; j++)
        store(&r->played[j], h->values[j]);
    p->tail = jawari_tail(h->engine);
    p->engine = h->engine;
    h->engine = before;
    r->leaving = h;
    r->faded = 0;
    p->quiet = 0;
}

void plugin_rebuild_mix(plugin *p, int32_t frames, float *const narrow[2], double *const wide[2]) {
    plugin_rebuild *r = p->rebuild;
    if (!r->leaving)
        return;
    for (int32_t done = 0, n; done < frames && r->faded < r->fade_frames; done += n, r->faded += n) {
        n = frames - done < SETUP_CHUNK ? frames - done : SETUP_CHUNK;
        n = r->fade_frames - r->faded < n ? r->fade_frames - r->faded : n;
        jawari_process(r->leaving->engine, NULL, 0, n, r->mix[0], r->mix[1]);
        for (int32_t i = 0; i < n; i++) {
            const double share = 1.0 - (double)(r->faded + i + 1) / (double)r->fade_frames;
            for (int side = 0; side < 2; side++)
                if (wide)
                    wide[side][done + i] += share * r->mix[side][i];
                else
                    narrow[side][done + i] = (float)(narrow[side][done + i] + share * r->mix[side][i]);
        }
    }
    if (r->faded >= r->fade_frames) {
        push(&r->gone, r->leaving);
        r->leaving = NULL;
        plugin_wake(r);
    }
}
