/* plugin_wishes.c: what setup is wished of an instance, and the thread that sees to it; see plugin_rebuild.h. */
#define _GNU_SOURCE
#include <errno.h>
#include <poll.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

#include "plugin_rebuild.h"

/* how long after the last wish it is seen to */
enum { MOMENT_MS = 300 };

/* ---- what is wished ---- */

bool plugin_same_number(double a, double b) {
    char one[48], other[48];
    plugin_write_number(one, sizeof one, a);
    plugin_write_number(other, sizeof other, b);
    return strcmp(one, other) == 0;
}

/* FNV-1a of 64 bits. */
static uint64_t hashed(uint64_t hash, const char *text) {
    do
        hash = (hash ^ (uint8_t)*text) * 1099511628211u;
    while (*text++);
    return hash;
}

plugin_wish *plugin_wish_of(const plugin *p, double rate_hz, const double *values) {
    enum { LINE = 224 };
    plugin_wish *w = calloc(1, sizeof *w + p->setups * (sizeof(double) + sizeof(char *) + LINE));
    if (!w)
        return NULL;
    w->values = (double *)(void *)(w + 1);
    w->settings = (char **)(void *)(w->values + p->setups);
    char *line = (char *)(w->settings + p->setups), text[64];
    snprintf(text, sizeof text, "%08x %.17g", jawari_bank_checksum(p->bank), rate_hz);
    uint64_t hash[2] = {hashed(14695981039346656037u, text), hashed(1099511628211u, text)};
    for (int h = 0; h < 2; h++)
        hash[h] = hashed(hash[h], jawari_kernels_version());
    for (uint32_t j = 0; j < p->setups; j++) {
        const plugin_parameter *q = &p->parameters[p->of_presets + j];
        w->values[j] = values ? values[p->of_presets + j] : plugin_value(p, p->of_presets + j);
        if (plugin_same_number(w->values[j], q->initial))
            continue;
        plugin_write_number(text, sizeof text, w->values[j]);
        snprintf(line, LINE, "%s=%s", q->id, text);
        for (int h = 0; h < 2; h++)
            hash[h] = hashed(hash[h], line);
        w->settings[w->count++] = line;
        line += LINE;
    }
    if (w->count)
        snprintf(w->key, sizeof w->key, "%016llx%016llx", (unsigned long long)hash[0], (unsigned long long)hash[1]);
    return w;
}

void plugin_path_of(const plugin *p, const char *key, char *path, size_t room) {
    snprintf(path, room, "%s/%s-%s.jawari", p->rebuild->python.banks, jawari_bank_id(p->bank), key);
}

/* ---- the thread ---- */

static int64_t now_ms(void) {
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return 1000 * (int64_t)t.tv_sec + t.tv_nsec / 1000000;
}

typedef struct work {
    plugin_wish *aim; /* what it works at, or has */
    int64_t begin_at, end_at; /* −1: not */
    plugin_child child;
} work;

static void fail(plugin *p, const char *why) {
    plugin_rebuild *r = p->rebuild;
    plugin_copy_text(r->why, sizeof r->why, why);
    plugin_copy_text(r->remark, sizeof r->remark, why);
    r->state = SETUP_FAILED;
}

static void tell(const plugin *p) {
    if (p->rebuild->changed)
        p->rebuild->changed(p->rebuild->whose);
}

static bool start(const plugin *p, work *w, char *why) {
    const plugin_rebuild *r = p->rebuild;
    char checksum[16], rate[48], path[PYTHON_PATH + 160];
    char *fixed[] = {(char *)r->python.program, "-m", "synth.plugin.rebuild", (char *)r->python.plugin, checksum, rate, path};
    enum { FIXED = sizeof fixed / sizeof *fixed };
    char **arguments = calloc(FIXED + w->aim->count + 1, sizeof *arguments);
    if (!arguments) {
        snprintf(why, JAWARI_WHY, "there is not enough memory for another setup");
        return false;
    }
    snprintf(checksum, sizeof checksum, "%08x", jawari_bank_checksum(p->bank));
    snprintf(rate, sizeof rate, "%.17g", r->rate_hz);
    plugin_path_of(p, w->aim->key, path, sizeof path);
    memcpy(arguments, fixed, sizeof fixed);
    memcpy(arguments + FIXED, w->aim->settings, w->aim->count * sizeof *arguments);
    const bool started = plugin_python_start(&r->python, arguments, &w->child, why);
    free(arguments);
    return started;
}

/* What is wished has been looked at: from here on it is had, failed, or being made. */
static void begin(plugin *p, work *w) {
    plugin_rebuild *r = p->rebuild;
    char why[JAWARI_WHY] = "";
    pthread_mutex_lock(&r->guard);
    const bool had = r->state == SETUP_PLAYED && strcmp(w->aim->key, r->key) == 0;
    if (!plugin_go_over(p, w->aim, why)) {
        if (*w->aim->key && start(p, w, why)) {
            r->state = SETUP_PREPARED;
            w->end_at = now_ms() + r->python.timeout_ms;
        } else
            fail(p, why);
    }
    pthread_mutex_unlock(&r->guard);
    if (!had)
        tell(p);
}

static void finish(plugin *p, work *w, bool late) {
    plugin_rebuild *r = p->rebuild;
    char why[JAWARI_WHY] = "";
    plugin_python_end(&w->child);
    w->end_at = -1;
    pthread_mutex_lock(&r->guard);
    if (late) {
        snprintf(why, sizeof why, "Python took longer than %d s and was ended", r->python.timeout_ms / 1000);
        fail(p, why);
    } else if (!plugin_go_over(p, w->aim, why))
        fail(p, *w->child.said ? w->child.said : *why ? why : "Python ended without a word");
    pthread_mutex_unlock(&r->guard);
    tell(p);
}

/* A wish that is another one than what it works at: that is given up, and a moment later the new one begun. */
static void look(plugin *p, work *w) {
    plugin_wish *next = plugin_wish_of(p, p->rebuild->rate_hz, NULL);
    if (!next)
        return;
    if (w->aim && strcmp(next->key, w->aim->key) == 0) {
        free(next);
        return;
    }
    plugin_python_end(&w->child);
    pthread_mutex_lock(&p->rebuild->guard);
    if (strcmp(next->key, p->rebuild->key) != 0)
        p->rebuild->state = SETUP_PREPARED;
    pthread_mutex_unlock(&p->rebuild->guard);
    free(w->aim);
    *w = (work){.aim = next, .begin_at = now_ms() + MOMENT_MS, .end_at = -1};
}

void *plugin_see_to_wishes(void *of) {
    plugin *p = of;
    plugin_rebuild *r = p->rebuild;
    work w = {.begin_at = -1, .end_at = -1};
    while (!atomic_load(&r->ending)) {
        plugin_sweep_engines(p);
        look(p, &w);
        const int64_t next = w.begin_at >= 0 ? w.begin_at : w.end_at, left = next - now_ms();
        struct pollfd ends[2] = {{r->token, POLLIN, 0}, {w.child.id ? w.child.out : -1, POLLIN, 0}};
        if (poll(ends, 2, next < 0 ? -1 : left > 0 ? (int)left : 0) < 0 && errno != EINTR)
            break;
        uint64_t woken;
        if (ends[0].revents && read(r->token, &woken, sizeof woken) < 0 && errno != EAGAIN)
            break;
        if (w.child.id && plugin_python_ended(&w.child))
            finish(p, &w, false);
        else if (w.end_at >= 0 && now_ms() >= w.end_at)
            finish(p, &w, true);
        else if (w.begin_at >= 0 && now_ms() >= w.begin_at) {
            w.begin_at = -1;
            begin(p, &w);
        }
    }
    plugin_python_end(&w.child);
    free(w.aim);
    return NULL;
}

void plugin_wake(const plugin_rebuild *r) {
    const uint64_t one = 1;
    if (r->token >= 0 && write(r->token, &one, sizeof one) < 0) {
        /* it is awake already: the counter is full */
    }
}
