/* plugin_block.c: what the audio thread does. No lock, no allocation; no system call but to wake who sees to a wish of the setup. */
#include <math.h>
#include <string.h>

#include "plugin_rebuild.h"

enum { PEDAL = 64, BRIGHTNESS = 74, ALL_NOTES_OFF = 123 };
/* What is softer than this is not heard any more (−120 dBFS), and for how many frames after the last string. */
#define INAUDIBLE 1e-6
enum { QUIET_FRAMES = 1024 };

void plugin_begin_anew(plugin *p, int64_t quiet) {
    for (uint32_t k = 0; k < p->count; k++)
        p->sent[k] = p->parameters[k].initial;
    for (int key = 0; key < PLUGIN_KEYS; key++) {
        p->pitches.tuned[key] = (double)NAN;
        p->pitches.bent[key] = 0;
    }
    p->gathered = 0;
    p->disordered = p->lost = p->late = p->owed = false;
    p->quiet = quiet;
    /* the bypass belongs to this file, not to the engine: it is as it was set */
    p->sent[p->bypass] = plugin_value(p, (uint32_t)p->bypass);
    p->bypassed = p->sent[p->bypass] > 0.0;
    p->gain = p->bypassed ? 0.0 : 1.0;
    plugin_drone_begin(p);
}

/* A state was loaded. What the bypass is set to is told as any other value: it fades. */
static void take_over(plugin *p) {
    const double bypass = p->sent[p->bypass], gain = p->gain;
    const bool bypassed = p->bypassed;
    jawari_reset(p->engine);
    plugin_begin_anew(p, 0);
    p->sent[p->bypass] = bypass;
    p->bypassed = bypassed;
    p->gain = gain;
}

/* The block begins with the first thing that is said of it. */
static void begin(plugin *p) {
    if (p->in_block)
        return;
    p->in_block = true;
    if (!p->engine)
        return;
    if (atomic_load_explicit(&p->loaded, memory_order_relaxed) && atomic_exchange(&p->loaded, false))
        take_over(p);
    plugin_rebuild_take(p);
}

static void put(plugin *p, const jawari_event *event) {
    if (p->gathered >= PLUGIN_EVENTS) {
        p->lost = true;
        return;
    }
    jawari_event *here = p->events + p->before + p->gathered;
    if (p->gathered++ > 0 && here[-1].frame > event->frame)
        p->disordered = true;
    *here = *event;
}

/* Where the run of events in order that begins at `at` ends. */
static int32_t run_end(const jawari_event *list, int32_t at, int32_t count) {
    while (++at < count && list[at - 1].frame <= list[at].frame) {
    }
    return at < count ? at : count;
}

/* The gathered events by their frames; those of one frame as they came. Hosts hand over run after run that is in order, one
 * for each parameter: neighbours are merged until one is left. */
static void put_in_order(plugin *p) {
    jawari_event *list = p->events + p->before, *from = list, *to = p->sorting;
    const int32_t count = p->gathered;
    while (run_end(from, 0, count) < count) {
        for (int32_t begin = 0; begin < count;) {
            const int32_t middle = run_end(from, begin, count);
            const int32_t end = middle < count ? run_end(from, middle, count) : count;
            for (int32_t a = begin, b = middle, k = begin; k < end; k++)
                to[k] = b >= end || (a < middle && from[a].frame <= from[b].frame) ? from[a++] : from[b++];
            begin = end;
        }
        jawari_event *other = from;
        from = to;
        to = other;
    }
    if (from != list)
        memcpy(list, from, (size_t)count * sizeof *list);
    p->disordered = false;
}

/* Which parameter a PARAMETER event sets, −1. */
static int64_t target_of(const plugin *p, const jawari_event *event) {
    for (uint32_t k = 0; k < p->of_presets; k++)
        if (p->targets[k].part == event->channel && p->targets[k].index == event->a)
            return k;
    return -1;
}

/* What the instance itself has to know of an event before the engine hears it. */
static void gather(plugin *p, const jawari_event *event) {
    begin(p);
    int32_t key = event->a;
    if (event->kind == JAWARI_PARAMETER) {
        int64_t k = target_of(p, event);
        if (k >= 0) {
            plugin_change(p, event->frame, (uint32_t)k, event->value);
            return;
        }
    } else if (event->kind == JAWARI_TUNING && key >= 0 && key < PLUGIN_KEYS) {
        p->pitches.tuned[key] = event->value;
        p->pitches.bent[key] = 0;
    } else if (event->kind == JAWARI_NOTE_ON && event->b > 0 && key >= 0 && key < PLUGIN_KEYS && p->pitches.bent[key]) {
        put(p, &(jawari_event){event->frame, JAWARI_TUNING, 0, key, 0, p->pitches.tuned[key]});
        p->pitches.bent[key] = 0;
    }
    put(p, event);
}

void plugin_put(plugin *p, const jawari_event *event) {
    begin(p);
    put(p, event);
}

void plugin_event(plugin *p, const jawari_event *event) {
    if (event->kind < PLUGIN_BYPASS)
        gather(p, event);
}

void plugin_midi(plugin *p, int64_t frame, const uint8_t *bytes, size_t size) {
    jawari_event events[128]; /* a bulk dump tunes every key */
    int32_t count = jawari_midi(bytes, size, frame, events, 128);
    for (int32_t i = 0; i < count && i < 128; i++)
        gather(p, &events[i]);
}

static int32_t seven_bits(double share, int32_t lowest) {
    if (!(share > 0.0)) /* what is no number neither */
        return lowest;
    int32_t whole = share >= 1.0 ? 127 : (int32_t)lrint(127.0 * share);
    return whole < lowest ? lowest : whole;
}

void plugin_note_on(plugin *p, int64_t frame, int32_t channel, int32_t key, double velocity) {
    gather(p, &(jawari_event){frame, JAWARI_NOTE_ON, channel, key, seven_bits(velocity, 1), 0.0});
}

void plugin_note_tuning(plugin *p, int64_t frame, int32_t channel, int32_t key, double semitones) {
    (void)channel; /* a key has one pitch on all channels */
    if (key < 0 || key >= PLUGIN_KEYS || !isfinite(semitones) || !p->engine)
        return;
    begin(p);
    double pitch = p->pitches.tuned[key];
    if (semitones != 0.0)
        pitch = (isfinite(pitch) ? pitch : jawari_pitch(p->engine, key)) + semitones;
    else if (!p->pitches.bent[key])
        return;
    p->pitches.bent[key] = semitones != 0.0;
    put(p, &(jawari_event){frame, JAWARI_TUNING, 0, key, 1, pitch});
}

void plugin_note_pressure(plugin *p, int64_t frame, int32_t channel, int32_t key, double pressure) {
    gather(p, &(jawari_event){frame, JAWARI_KEY_PRESSURE, channel, key, seven_bits(pressure, 0), 0.0});
}

void plugin_note_brightness(plugin *p, int64_t frame, int32_t channel, int32_t key, double brightness) {
    (void)key;
    gather(p, &(jawari_event){frame, JAWARI_CONTROL, channel, BRIGHTNESS, seven_bits(brightness, 0), 0.0});
}

/* The events that tell a value to who is concerned; their number. Room for PLUGIN_CHANNELS. */
static int32_t tell(const plugin *p, int64_t frame, uint32_t k, double value, jawari_event *events) {
    if (k < p->of_presets) {
        events[0] = (jawari_event){frame, JAWARI_PARAMETER, p->targets[k].part, p->targets[k].index, 0, value};
        return 1;
    }
    if ((int64_t)k == p->bypass) {
        events[0] = (jawari_event){frame, PLUGIN_BYPASS, 0, value > 0.0, 0, 0.0};
        return 1;
    }
    if ((int64_t)k != p->program) {
        events[0] = (jawari_event){frame, PLUGIN_DRONE, 0, (int32_t)(k - p->drone.first), 0, value};
        return 1;
    }
    for (int32_t c = 0; c < PLUGIN_CHANNELS; c++)
        events[c] = (jawari_event){frame, JAWARI_PROGRAM, c, (int32_t)value, 0, 0.0};
    return PLUGIN_CHANNELS;
}

static void put_value(plugin *p, int64_t frame, uint32_t k, double value) {
    jawari_event events[PLUGIN_CHANNELS];
    int32_t count = tell(p, frame, k, value, events);
    if (count > PLUGIN_EVENTS - p->gathered) {
        p->late = true;
        return;
    }
    for (int32_t i = 0; i < count; i++)
        put(p, &events[i]);
    p->sent[k] = value;
}

void plugin_change(plugin *p, int64_t frame, uint32_t k, double value) {
    if (k >= p->count || !isfinite(value))
        return;
    if (plugin_is_setup(p, k)) {
        plugin_set(p, k, value);
        return;
    }
    begin(p);
    double before = plugin_value(p, k);
    if (before != p->sent[k]) /* set by another thread, and heard until this frame */
        put_value(p, 0, k, before);
    value = plugin_kept(&p->parameters[k], value);
    plugin_store(p, k, value);
    put_value(p, frame, k, value);
}

/* The end of all notes, held by the pedal too: PLUGIN_LETTING_GO events. */
static void let_all_go(jawari_event *events, int64_t frame) {
    for (int32_t c = 0; c < PLUGIN_CHANNELS; c++) {
        *events++ = (jawari_event){frame, JAWARI_CONTROL, c, PEDAL, 0, 0.0};
        *events++ = (jawari_event){frame, JAWARI_CONTROL, c, ALL_NOTES_OFF, 0, 0.0};
    }
}

static int64_t dropped(const plugin *p) {
    jawari_report report;
    jawari_report_of(p->engine, &report);
    return report.dropped;
}

/* Values set outside of a block, before all that was gathered; where the block's events begin. */
static jawari_event *tell_what_was_set(plugin *p) {
    jawari_event *first = p->events + p->before;
    if (p->owed)
        let_all_go(first -= PLUGIN_LETTING_GO, 0);
    for (uint32_t k = p->late ? 0 : p->count; k-- > 0;) {
        double value = plugin_value(p, k);
        if (value == p->sent[k] || plugin_is_setup(p, k))
            continue;
        jawari_event events[PLUGIN_CHANNELS];
        int32_t count = tell(p, 0, k, value, events);
        first -= count;
        memcpy(first, events, (size_t)count * sizeof *events);
        p->sent[k] = value;
    }
    return first;
}

/* A plugin that is bypassed plays no new notes; the old ones go on, unheard, and end. */
static bool leave_out_bypassed(const plugin *p, jawari_event *events, int32_t count) {
    bool bypassed = p->bypassed, concerned = bypassed;
    for (int32_t i = 0; i < count; i++)
        if (events[i].kind == PLUGIN_BYPASS)
            concerned = true, bypassed = events[i].a != 0;
        else if (bypassed && events[i].kind == JAWARI_NOTE_ON && events[i].b > 0)
            events[i].kind = PLUGIN_NOTHING;
    return concerned;
}

/* In and out of the bypass within milliseconds. */
static void fade(plugin *p, const jawari_event *events, int32_t count, int32_t frames, float *const narrow[2],
                 double *const wide[2]) {
    int32_t at = 0;
    for (int32_t i = 0; i < frames; i++) {
        for (; at < count && (events[at].frame <= i || i == frames - 1); at++)
            if (events[at].kind == PLUGIN_BYPASS)
                p->bypassed = events[at].a != 0;
        p->gain = p->bypassed ? fmax(0.0, p->gain - p->gain_step) : fmin(1.0, p->gain + p->gain_step);
        for (int side = 0; side < 2; side++)
            if (wide)
                wide[side][i] *= p->gain;
            else
                narrow[side][i] = (float)(narrow[side][i] * p->gain);
    }
    for (; at < count; at++) /* a block without frames */
        if (events[at].kind == PLUGIN_BYPASS)
            p->bypassed = events[at].a != 0;
}

static bool audible(int32_t frames, float *const narrow[2], double *const wide[2]) {
    for (int side = 0; side < 2; side++)
        for (int32_t i = 0; i < frames; i++)
            if (!(fabs(wide ? wide[side][i] : (double)narrow[side][i]) <= INAUDIBLE))
                return true;
    return false;
}

void plugin_process(plugin *p, int32_t frames, float *const left_right[2], double *const left_right_wide[2]) {
    float *const *narrow = left_right_wide ? NULL : left_right;
    double *const *wide = left_right_wide;
    frames = frames < 0 ? 0 : frames;
    begin(p);
    if (!p->engine) {
        for (int side = 0; side < 2; side++)
            if (wide)
                memset(wide[side], 0, (size_t)frames * sizeof(double));
            else
                memset(narrow[side], 0, (size_t)frames * sizeof(float));
        p->gathered = 0;
        p->disordered = p->lost = p->late = false;
        p->in_block = false;
        return;
    }
    if (p->disordered)
        put_in_order(p);
    jawari_event *events = tell_what_was_set(p);
    jawari_event *past = p->events + p->before + p->gathered;
    if (p->lost) { /* there may be ends of notes among what found no room: none may hang */
        let_all_go(past, frames);
        past += PLUGIN_LETTING_GO;
    }
    int32_t count = (int32_t)(past - events);
    if (p->drone.score) {
        count = plugin_drone_play(p, events, count, frames);
        events = p->drone.events;
    }
    bool concerned = leave_out_bypassed(p, events, count);
    const int64_t before = dropped(p);
    if (wide)
        jawari_process(p->engine, events, count, frames, wide[0], wide[1]);
    else
        jawari_process_float(p->engine, events, count, frames, narrow[0], narrow[1]);
    plugin_rebuild_mix(p, frames, narrow, wide);
    if (concerned || p->gain < 1.0)
        fade(p, events, count, frames, narrow, wide);
    if (!jawari_silent(p->engine) || audible(frames, narrow, wide))
        p->quiet = 0;
    else if (p->quiet < INT64_MAX / 2)
        p->quiet += frames;
    /* the engine's queue fills over short blocks, until it takes what lets all go */
    p->owed = dropped(p) > before;
    p->gathered = 0;
    p->lost = p->late = false;
    p->in_block = false;
}

void plugin_reset(plugin *p) {
    if (!p->engine)
        return;
    jawari_reset(p->engine);
    plugin_begin_anew(p, 0);
    p->in_block = false;
}

bool plugin_silent(const plugin *p) {
    if (!p->engine)
        return true;
    if (p->gathered || p->owed || plugin_drone_waits(p) || p->quiet < p->latency + QUIET_FRAMES ||
        atomic_load_explicit(&p->loaded, memory_order_relaxed))
        return false;
    for (uint32_t k = 0; k < p->count; k++)
        if (plugin_value(p, k) != p->sent[k] && !plugin_is_setup(p, k))
            return false;
    return true;
}

int32_t plugin_voices(const plugin *p) { return p->engine ? jawari_voices(p->engine) : 0; }

bool plugin_sounding(const plugin *p, int32_t channel, int32_t key) {
    return p->engine && jawari_sounding(p->engine, channel, key);
}

void plugin_help(plugin *p, int32_t k) {
    if (p->engine)
        jawari_help(p->engine, k);
}
