/* plugin_maker.c: the thread that sees to wishes, and has banks made by Python; see plugin_rebuild.h. Where there are no processes
 * plugin_alone.c takes its place. */
#define _GNU_SOURCE
#define _DARWIN_C_SOURCE
#include <errno.h>
#include <poll.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

#include "plugin_rebuild.h"
#include "system_posix.h"

/* how long after the last wish it is seen to */
enum { MOMENT_MS = 300, STACK = 1 << 20 };

void plugin_maker_path(const plugin *p, const char *key, char *path, size_t room) {
    snprintf(path, room, "%s/%s-%s.jawari", p->rebuild->python.banks, jawari_bank_id(p->bank), key);
}

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
    plugin_maker_path(p, w->aim->key, path, sizeof path);
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
    system_lock(&r->guard);
    const bool had = r->state == SETUP_PLAYED && strcmp(w->aim->key, r->key) == 0;
    if (!plugin_go_over(p, w->aim, why)) {
        if (*w->aim->key && start(p, w, why)) {
            r->state = SETUP_PREPARED;
            w->end_at = now_ms() + r->python.timeout_ms;
        } else
            fail(p, why);
    }
    system_unlock(&r->guard);
    if (!had)
        tell(p);
}

static void finish(plugin *p, work *w, bool late) {
    plugin_rebuild *r = p->rebuild;
    char why[JAWARI_WHY] = "";
    plugin_python_end(&w->child);
    w->end_at = -1;
    system_lock(&r->guard);
    if (late) {
        snprintf(why, sizeof why, "Python took longer than %d s and was ended", r->python.timeout_ms / 1000);
        fail(p, why);
    } else if (!plugin_go_over(p, w->aim, why))
        fail(p, *w->child.said ? w->child.said : *why ? why : "Python ended without a word");
    system_unlock(&r->guard);
    tell(p);
}

/* A wish that is another one than what it works at: that is given up, and a moment later the new one begun. */
static void look(plugin *p, work *w) {
    plugin_wish *next = plugin_wish_of(p, p->rebuild->rate_hz);
    if (!next)
        return;
    if (w->aim && strcmp(next->key, w->aim->key) == 0) {
        free(next);
        return;
    }
    plugin_python_end(&w->child);
    system_lock(&p->rebuild->guard);
    if (strcmp(next->key, p->rebuild->key) != 0)
        p->rebuild->state = SETUP_PREPARED;
    system_unlock(&p->rebuild->guard);
    free(w->aim);
    *w = (work){.aim = next, .begin_at = now_ms() + MOMENT_MS, .end_at = -1};
}

static void see_to_wishes(void *of) {
    plugin *p = of;
    plugin_rebuild *r = p->rebuild;
    work w = {.begin_at = -1, .end_at = -1};
    while (!atomic_load(&r->ending)) {
        plugin_sweep_engines(p);
        look(p, &w);
        const int64_t next = w.begin_at >= 0 ? w.begin_at : w.end_at, left = next - now_ms();
        struct pollfd ends[2] = {{r->alarm[0], POLLIN, 0}, {w.child.id ? w.child.out : -1, POLLIN, 0}};
        if (poll(ends, 2, next < 0 ? -1 : left > 0 ? (int)left : 0) < 0 && errno != EINTR)
            break;
        uint64_t woken;
        if (ends[0].revents && read(r->alarm[0], &woken, sizeof woken) < 0 && errno != EAGAIN)
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
}

/* ---- its life ---- */

bool plugin_maker_new(plugin_rebuild *r) {
    return plugin_python_find(&r->python) && system_alarm(r->alarm);
}

void plugin_maker_free(plugin_rebuild *r) {
    if (r->there) {
        close(r->alarm[0]);
        if (r->alarm[1] != r->alarm[0])
            close(r->alarm[1]);
    }
    plugin_python_free(&r->python);
}

bool plugin_maker_start(plugin *p) { return system_thread_start(&p->rebuild->thread, see_to_wishes, p, STACK, true); }

void plugin_wake(const plugin_rebuild *r) {
    const uint64_t one = 1;
    if (r->there && write(r->alarm[1], &one, sizeof one) < 0) {
        /* it is awake already: there is no room for more */
    }
}
