/* plugin_drone.c: a drone that plays by itself, at its own pace or in beats of the host. No lock, no allocation.
 *
 * The score gives every stroke's place and how the hand strays; here it gets its time. Strokes are numbered from the first string
 * of cycle 0 on, below 0 where the host's place is. At its own pace stroke n is due at
 *
 *     anchor_s + (place(n) − anchor) · pace + sway(n) · pace
 *
 * seconds behind the origin, in this order of operations, which is that of synth.drone. While the host plays in beats, it stands
 * where the host's place is place(n) cycles, and strays by what is the hand's own, for the host is the grid.
 */
#include <math.h>
#include <string.h>

#include "plugin_private.h"

/* A host's place that is so near to the one expected is that, one so near has strayed, and all else is a jump [quarter notes];
 * cycles that are this near are one place. */
#define SAME 1e-6
#define STRAYED 0.0625
#define NEAR 1e-6
#define LEAST_TEMPO 1.0
#define MOST_TEMPO 2000.0
#define FARTHEST_BEAT 1e9
/* frames and numbers of strokes are below: doubles hold them */
#define MOST_WHOLE ((int64_t)1 << 52)
enum { STROKE_EVENTS = 7, MOST_STROKES = 512, MOST_TURNS = 256 };

static int64_t whole(double x) {
    const double most = (double)MOST_WHOLE;
    return !(x > -most) ? -MOST_WHOLE : x < most ? llrint(x) : MOST_WHOLE;
}

static int64_t remainder_of(int64_t n, int64_t by) { return n % by < 0 ? n % by + by : n % by; }

/* ---- the score in time ---- */

static uint32_t string_of(const plugin_drone *d, int64_t n) { return (uint32_t)remainder_of(n, d->score->strings); }

static double place_of(const plugin_drone *d, int64_t n) {
    const int64_t string = string_of(d, n);
    return (double)((n - string) / d->score->strings) + d->score->places[string];
}

static const struct drone_stroke *variation(const plugin_drone *d, int64_t n) {
    return drone_stroke_of(d->score, (uint64_t)remainder_of(n, d->score->strokes));
}

static bool by_host(const plugin_drone *d) { return d->place.value[DRONE_PACE] > 0.0 && isfinite(d->place.tempo); }

/* Of a cycle [s]. */
static double pace_s(const plugin_drone *d) {
    return by_host(d) ? d->place.value[DRONE_BEATS] * 60.0 / d->place.tempo : d->place.value[DRONE_SECONDS];
}

/* At its own pace, behind the origin [s]. */
static double due_s(const plugin_drone *d, int64_t n, bool jitter) {
    const double pace = pace_s(d);
    const struct drone_stroke *x = variation(d, n);
    return d->place.anchor_s + (place_of(d, n) - d->place.anchor) * pace + (jitter ? x->sway : x->wander) * pace;
}

static double beat_of(const drone_place *m, int64_t frame, double rate) {
    return m->beat + (double)(frame - m->beat_at) * m->tempo / (60.0 * rate);
}

static double beat_at(const plugin_drone *d, int64_t frame) { return beat_of(&d->place, frame, d->rate); }

/* Where it is at a frame [cycles]. */
static double cycles_at(const plugin_drone *d, int64_t frame) {
    if (d->place.locked)
        return beat_at(d, frame) / d->place.value[DRONE_BEATS];
    return d->place.anchor + ((double)(frame - d->place.origin) / d->rate - d->place.anchor_s) / pace_s(d);
}

static int64_t stroke_frame(const plugin_drone *d) {
    const drone_place *m = &d->place;
    int64_t frame;
    if (m->locked) {
        const struct drone_stroke *x = variation(d, m->next);
        const double beat = (place_of(d, m->next) + (x->sway - x->wander)) * m->value[DRONE_BEATS];
        frame = m->beat_at + whole((beat - m->beat) * 60.0 / m->tempo * d->rate);
    } else
        frame = m->origin + whole(due_s(d, m->next, true) * d->rate);
    return frame < d->at ? d->at : frame;
}

/* ---- what it does ---- */

static void put(plugin_drone *d, int64_t frame, int32_t kind, int32_t channel, int32_t a, int32_t b, double value) {
    if (d->count < d->room)
        d->events[d->count++] = (jawari_event){frame - d->begin, kind, channel, a, b, value};
}

static void put_finger(plugin_drone *d, int64_t frame, double position, double width) {
    put(d, frame, JAWARI_PARAMETER, d->score->part, d->score->position, 0, position);
    put(d, frame, JAWARI_PARAMETER, d->score->part, d->score->width, 0, width);
}

static void let_go(plugin_drone *d, int64_t frame) {
    if (d->place.held >= 0)
        put(d, frame, JAWARI_NOTE_OFF, d->score->channel, (int32_t)d->place.held, 64, 0.0);
    d->place.held = -1;
}

/* Pluck the next string; where a block has too many strokes, it is left out. */
static void pluck(plugin *p, int64_t frame) {
    plugin_drone *d = &p->drone;
    drone_place *m = &d->place;
    const struct drone_stroke *x = variation(d, m->next);
    const int32_t key = d->score->keys[string_of(d, m->next)];
    m->next++;
    if (d->strokes++ >= MOST_STROKES)
        return;
    let_go(d, frame);
    if (p->pitches.bent[key]) {
        put(d, frame, JAWARI_TUNING, 0, key, 0, p->pitches.tuned[key]);
        p->pitches.bent[key] = 0;
    }
    const double velocity = fmin(fmax(rint(m->value[DRONE_VELOCITY] * x->louder), 1.0), 127.0);
    put_finger(d, frame, m->position + x->farther, m->width * x->wider);
    put(d, frame, JAWARI_NOTE_ON, d->score->channel, key, (int32_t)velocity, 0.0);
    put_finger(d, frame, m->position, m->width); /* as the player of other notes has it */
    m->held = key;
    m->plucked = 1;
}

/* The pegs so far on their way, all strings together. */
static void turn(plugin *p, int64_t frame, double most) {
    plugin_drone *d = &p->drone;
    drone_place *m = &d->place;
    const double wanted = m->value[DRONE_TONIC];
    m->tonic = m->tonic < wanted ? fmin(m->tonic + most, wanted) : fmax(m->tonic - most, wanted);
    m->turn = m->tonic == wanted ? -1 : frame + whole(fmax(1.0, rint(d->score->step_s * d->rate)));
    const double step = m->tonic - d->score->step_low, low = fmin(floor(step), (double)(d->score->steps - 1));
    const double *below = drone_pitches(d->score, (uint32_t)low);
    const double *above = step > low ? below + d->score->strings : below;
    for (uint32_t k = 0; k < d->score->strings; k++) {
        const int32_t key = d->score->keys[k];
        const double pitch = below[k] + (above[k] - below[k]) * (step - low);
        put(d, frame, JAWARI_TUNING, 0, key, 1, pitch);
        p->pitches.tuned[key] = pitch;
        p->pitches.bent[key] = 0;
    }
}

/* All that is due before a frame. */
static void advance(plugin *p, int64_t until) {
    plugin_drone *d = &p->drone;
    drone_place *m = &d->place;
    for (int turns = 0; turns < MOST_TURNS && d->strokes < MOST_STROKES;) {
        const int64_t stroke = m->running ? stroke_frame(d) : INT64_MAX;
        const int64_t peg = m->turn < 0 ? INT64_MAX : m->turn < d->at ? d->at : m->turn;
        if (stroke >= until && peg >= until)
            break;
        d->at = peg <= stroke ? peg : stroke;
        if (peg <= stroke)
            turn(p, peg, d->score->step_s / d->score->semitone_s), turns++;
        else
            pluck(p, stroke);
    }
    d->at = until;
}

/* ---- what changes ---- */

/* As it was before something changed. */
typedef struct before {
    bool locked;
    double cycles, pace_s, due_s;
} before;

static before look(const plugin_drone *d, int64_t frame) {
    if (!d->place.running)
        return (before){0};
    return (before){d->place.locked, cycles_at(d, frame), pace_s(d), due_s(d, d->place.next, false)};
}

/* The host's place is another: the stroke that is next there. What the hand was late with is plucked now, and what it had been
 * early with, at the end of a loop, is not plucked again at its beginning. */
static void seek(plugin *p, int64_t frame, const before *b) {
    plugin_drone *d = &p->drone;
    drone_place *m = &d->place;
    const double cycles = cycles_at(d, frame);
    int64_t n = whole(floor(cycles)) * (int64_t)d->score->strings;
    while (place_of(d, n) < cycles - NEAR)
        n++;
    if (b->locked && m->plucked) {
        if (place_of(d, m->next) < b->cycles - NEAR)
            pluck(p, frame);
        const double early = place_of(d, m->next - 1) - b->cycles;
        if (early > -NEAR && string_of(d, m->next - 1) == string_of(d, n) && fabs(place_of(d, n) - cycles - early) < 1e-3)
            n++;
    }
    m->next = n;
}

/* Begin, end, or go on otherwise. jumped: the host's place is not where it was going. */
static void follow(plugin *p, int64_t frame, const before *b, bool jumped) {
    plugin_drone *d = &p->drone;
    drone_place *m = &d->place;
    const bool wanted = m->value[DRONE_MODE] == (double)DRONE_ON || (m->value[DRONE_MODE] == (double)DRONE_WITH_HOST && m->playing);
    const bool lock = wanted && by_host(d) && m->playing && isfinite(m->beat);
    if (!wanted) {
        if (m->running)
            let_go(d, frame);
        m->running = m->locked = 0;
        return;
    }
    if (!m->running) {
        m->running = 1;
        m->origin = frame;
        m->anchor_s = d->score->lead_s;
        m->anchor = 0.0;
        m->next = 0;
        m->locked = lock;
        if (lock)
            seek(p, frame, b);
    } else if (lock) {
        m->locked = 1;
        if (!b->locked || jumped)
            seek(p, frame, b);
    } else if (b->locked) { /* on from where it is */
        m->locked = 0;
        m->anchor = b->cycles;
        m->anchor_s = (double)(frame - m->origin) / d->rate;
    } else if (pace_s(d) != b->pace_s) { /* from the next stroke on */
        m->anchor = place_of(d, m->next);
        m->anchor_s = 0.0;
        m->anchor_s = b->due_s - due_s(d, m->next, false);
    }
}

static void set(plugin *p, int64_t frame, int32_t k, double value) {
    plugin_drone *d = &p->drone;
    drone_place *m = &d->place;
    const before b = look(d, frame);
    m->value[k] = value;
    if (k == DRONE_TONIC && m->tonic != value) {
        if (!m->plucked)
            turn(p, frame, INFINITY);
        else if (m->turn < 0)
            m->turn = frame;
    } else if (k != DRONE_VELOCITY && k != DRONE_TONIC)
        follow(p, frame, &b, k == DRONE_BEATS);
}

static void host_is(plugin *p, int64_t frame, bool playing, double tempo, double beat) {
    plugin_drone *d = &p->drone;
    drone_place *m = &d->place;
    tempo = tempo >= LEAST_TEMPO && tempo <= MOST_TEMPO ? tempo : (double)NAN;
    beat = playing && isfinite(tempo) && fabs(beat) <= FARTHEST_BEAT ? beat : (double)NAN;
    const double expected = m->playing ? beat_at(d, frame) : (double)NAN;
    const bool known = isfinite(beat) && isfinite(expected), same = known && fabs(beat - expected) < SAME;
    if (same && tempo == m->tempo)
        return;
    const before b = look(d, frame);
    const bool jumped = !(known && fabs(beat - expected) < STRAYED);
    m->playing = playing;
    m->tempo = tempo;
    m->beat = same ? expected : beat;
    m->beat_at = frame;
    follow(p, frame, &b, jumped);
}

/* ---- blocks ---- */

void plugin_drone_begin(plugin *p) {
    plugin_drone *d = &p->drone;
    if (!d->score)
        return;
    drone_place *m = &d->place;
    const drone_place was = *m;
    memset(m, 0, sizeof *m);
    for (int k = 0; k < DRONE_PARAMETERS; k++)
        m->value[k] = p->parameters[d->first + (uint32_t)k].initial;
    for (uint32_t k = 0; k < p->of_presets; k++)
        if (p->targets[k].part == d->score->part) {
            if (p->targets[k].index == d->score->position)
                m->position = p->parameters[k].initial;
            if (p->targets[k].index == d->score->width)
                m->width = p->parameters[k].initial;
        }
    /* what the host has said of itself it may not say again */
    m->playing = was.playing;
    m->tempo = d->rate > 0.0 ? was.tempo : (double)NAN;
    m->beat = d->rate > 0.0 && was.playing ? beat_of(&was, was.now, d->rate) : (double)NAN;
    m->turn = m->held = -1;
    m->fresh = 1;
    d->told_tempo = m->tempo;
}

void plugin_transport(plugin *p, int64_t frame, bool playing, double beat, double tempo) {
    if (!p->drone.score || !p->engine)
        return;
    plugin_put(p, &(jawari_event){frame, PLUGIN_TEMPO, 0, 0, 0, tempo});
    plugin_put(p, &(jawari_event){frame, PLUGIN_PLACE, 0, playing, 0, beat});
}

int32_t plugin_drone_room(int32_t events) { return events + STROKE_EVENTS * MOST_STROKES + DRONE_STRINGS * MOST_TURNS; }

int32_t plugin_drone_play(plugin *p, const jawari_event *events, int32_t count, int32_t frames) {
    plugin_drone *d = &p->drone;
    drone_place *m = &d->place;
    d->begin = d->at = m->now;
    d->count = d->strokes = 0;
    if (m->fresh) {
        m->fresh = 0;
        follow(p, d->begin, &(before){0}, true);
    }
    for (int32_t i = 0; i < count; i++) {
        const jawari_event *x = &events[i];
        const int64_t most = frames > 0 ? frames - 1 : 0;
        const int64_t frame = d->begin + (x->frame < 0 ? 0 : x->frame > most ? most : x->frame);
        if (frame > d->at)
            advance(p, frame);
        switch (x->kind) {
        case PLUGIN_DRONE:
            set(p, frame, x->a, x->value);
            break;
        case PLUGIN_TEMPO:
            d->told_tempo = x->value;
            break;
        case PLUGIN_PLACE:
            host_is(p, frame, x->a != 0, d->told_tempo, x->value);
            break;
        case JAWARI_PARAMETER:
            if (x->channel == d->score->part && x->a == d->score->position)
                m->position = x->value;
            if (x->channel == d->score->part && x->a == d->score->width)
                m->width = x->value;
            put(d, frame, x->kind, x->channel, x->a, x->b, x->value);
            break;
        default:
            put(d, frame, x->kind, x->channel, x->a, x->b, x->value);
        }
    }
    if (frames > 0)
        advance(p, d->begin + frames);
    m->now += frames;
    return d->count;
}

bool plugin_drone_waits(const plugin *p) {
    const drone_place *m = &p->drone.place;
    return p->drone.score && (m->running || m->turn >= 0 || m->value[DRONE_MODE] != (double)DRONE_OFF);
}
