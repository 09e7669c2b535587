/* clap_events.c: what a CLAP host says, and what it is told. */
#include <math.h>
#include <string.h>

#include "clap_private.h"

enum { ALL_SOUND_OFF = 120 };
/* An event reaches the strings at the latest so many frames after its own. */
enum { SETTLED_FRAMES = 64 };

/* ---- notes by their address ---- */

typedef struct address {
    int32_t id;
    int16_t port, channel, key;
} address;

/* Whether it can be one of this plugin's; −1 stands for all. */
static bool possible(const address *a) {
    return a->port >= -1 && a->port <= 0 && a->channel >= -1 && a->channel < CLAP_CHANNELS && a->key >= -1 && a->key < CLAP_KEYS;
}

static bool meant(const address *a, int32_t channel, int32_t key, const clap_note *note) {
    return (a->channel < 0 || a->channel == channel) && (a->key < 0 || a->key == key) &&
           (a->id < 0 || note->id < 0 || a->id == note->id);
}

/* The next open note from (channel, key) on that is meant; false: there is none. */
static bool next_meant(const clap_notes *notes, const address *a, int32_t *channel, int32_t *key) {
    for (; *channel < CLAP_CHANNELS; ++*channel, *key = 0)
        for (; *key < CLAP_KEYS; ++*key) {
            const clap_note *note = &notes->of[*channel][*key];
            if (note->open && meant(a, *channel, *key, note))
                return true;
        }
    return false;
}

static bool push(clap_instance *m, const clap_output_events_t *out, clap_event_header_t *header) {
    if (header->time < m->last_time)
        header->time = m->last_time;
    m->last_time = header->time;
    return out && out->try_push && out->try_push(out, header);
}

static bool tell_end(clap_instance *m, uint32_t time, int32_t channel, int32_t key, const clap_output_events_t *out) {
    clap_note *note = &m->notes.of[channel][key];
    clap_event_note_t event = {.header = {sizeof event, time, CLAP_CORE_EVENT_SPACE_ID, CLAP_EVENT_NOTE_END, 0},
                               .note_id = note->id, .port_index = 0, .channel = (int16_t)channel, .key = (int16_t)key};
    if (!push(m, out, &event.header))
        return false;
    note->open = false;
    m->notes.open--;
    return true;
}

void clap_forget_notes(clap_instance *m) { memset(&m->notes, 0, sizeof m->notes); }

/* ---- events ---- */

static void begin_note(clap_instance *m, const clap_event_note_t *event, const clap_output_events_t *out) {
    if (event->key < 0)
        return;
    int32_t channel = event->channel < 0 ? 0 : event->channel;
    clap_note *note = &m->notes.of[channel][event->key];
    if (note->open && !tell_end(m, event->header.time, channel, event->key, out))
        m->notes.open--; /* no room for that in the host's list: it is over all the same */
    const uint32_t time = event->header.time < INT32_MAX ? event->header.time : INT32_MAX;
    *note = (clap_note){.id = event->note_id, .open = true, .age = -(int32_t)time};
    m->notes.open++;
    plugin_note_on(m->p, event->header.time, channel, event->key, event->velocity);
}

static void let_go(clap_instance *m, int64_t frame, int32_t channel, int32_t key, double velocity) {
    m->notes.of[channel][key].released = true;
    double release = velocity > 0.0 ? (velocity < 1.0 ? velocity : 1.0) : 0.0;
    plugin_event(m->p, &(jawari_event){frame, JAWARI_NOTE_OFF, channel, key, (int32_t)(127.0 * release + 0.5), 0.0});
}

static void end_notes(clap_instance *m, const clap_event_note_t *event, const address *a) {
    int32_t channel = a->channel, key = a->key;
    if (channel >= 0 && key >= 0) {
        /* an end that comes for a note which another of the same key has followed is none of the other's */
        const clap_note *note = &m->notes.of[channel][key];
        if (!note->open || meant(a, channel, key, note))
            let_go(m, event->header.time, channel, key, event->velocity);
        return;
    }
    for (channel = key = 0; next_meant(&m->notes, a, &channel, &key); key++)
        if (!m->notes.of[channel][key].released)
            let_go(m, event->header.time, channel, key, event->velocity);
}

/* The engine silences channels, not notes: where others sound on the channel, the notes are let go instead. */
static void choke(clap_instance *m, const clap_event_note_t *event, const address *a) {
    for (int32_t channel = 0; channel < CLAP_CHANNELS; channel++) {
        if (a->channel >= 0 && a->channel != channel)
            continue;
        bool others = false, any = false;
        for (int32_t key = 0; key < CLAP_KEYS; key++) {
            const clap_note *note = &m->notes.of[channel][key];
            bool mine = meant(a, channel, key, note);
            any = any || (note->open && mine);
            others = others || (note->open && !mine);
        }
        bool named = a->channel >= 0 && !m->notes.open; /* notes that came as MIDI */
        if (!any && !named)
            continue;
        for (int32_t key = 0; key < CLAP_KEYS; key++)
            if (m->notes.of[channel][key].open && meant(a, channel, key, &m->notes.of[channel][key]))
                let_go(m, event->header.time, channel, key, 1.0);
        if (!others)
            plugin_event(m->p, &(jawari_event){event->header.time, JAWARI_CONTROL, channel, ALL_SOUND_OFF, 0, 0.0});
    }
}

static void express_one(clap_instance *m, const clap_event_note_expression_t *event, int32_t channel, int32_t key) {
    int64_t frame = event->header.time;
    if (event->expression_id == CLAP_NOTE_EXPRESSION_TUNING)
        plugin_note_tuning(m->p, frame, channel, key, event->value);
    else if (event->expression_id == CLAP_NOTE_EXPRESSION_PRESSURE)
        plugin_note_pressure(m->p, frame, channel, key, event->value);
    else if (event->expression_id == CLAP_NOTE_EXPRESSION_BRIGHTNESS)
        plugin_note_brightness(m->p, frame, channel, key, event->value);
}

static void express(clap_instance *m, const clap_event_note_expression_t *event, const address *a) {
    int32_t channel = a->channel, key = a->key;
    if (channel >= 0 && key >= 0) {
        const clap_note *note = &m->notes.of[channel][key];
        if (!note->open || meant(a, channel, key, note))
            express_one(m, event, channel, key);
        return;
    }
    for (channel = key = 0; next_meant(&m->notes, a, &channel, &key); key++)
        express_one(m, event, channel, key);
}

static void change(clap_instance *m, const clap_event_param_value_t *event, bool sounding) {
    int64_t k = plugin_find(m->p, event->param_id);
    if (k < 0)
        return;
    if (sounding)
        plugin_change(m->p, event->header.time, (uint32_t)k, event->value);
    else
        plugin_set(m->p, (uint32_t)k, event->value);
    m->told[k] = plugin_value(m->p, (uint32_t)k);
}

void clap_transport(clap_instance *m, uint32_t time, const clap_event_transport_t *transport) {
    const uint32_t flags = transport ? transport->flags : 0;
    const bool timed = flags & CLAP_TRANSPORT_HAS_TEMPO, placed = flags & CLAP_TRANSPORT_HAS_BEATS_TIMELINE;
    const double beat = placed ? (double)transport->song_pos_beats / (double)CLAP_BEATTIME_FACTOR : (double)NAN;
    plugin_transport(m->p, time, flags & CLAP_TRANSPORT_IS_PLAYING, beat, timed ? transport->tempo : (double)NAN);
}

static void hear_midi(clap_instance *m, const clap_event_midi_t *event) {
    uint8_t status = event->data[0];
    if (status < 0x80 || status >= 0xF0 || event->port_index != 0)
        return;
    bool of_two = status >= 0xC0 && status < 0xE0;
    plugin_midi(m->p, event->header.time, event->data, of_two ? 2 : 3);
}

void clap_hear(clap_instance *m, const clap_event_header_t *event, const clap_output_events_t *out) {
    if (!event || event->space_id != CLAP_CORE_EVENT_SPACE_ID || event->size < sizeof *event)
        return;
    const clap_event_note_t *note = (const void *)event;
    const clap_event_note_expression_t *expression = (const void *)event;
    const clap_event_param_value_t *value = (const void *)event;
    const clap_event_transport_t *transport = (const void *)event;
    const clap_event_midi_t *midi = (const void *)event;
    const clap_event_midi_sysex_t *sysex = (const void *)event;
    address a;
    switch (event->type) {
    case CLAP_EVENT_NOTE_ON:
    case CLAP_EVENT_NOTE_OFF:
    case CLAP_EVENT_NOTE_CHOKE:
        if (event->size < sizeof *note)
            return;
        a = (address){note->note_id, note->port_index, note->channel, note->key};
        if (!possible(&a))
            return;
        if (event->type == CLAP_EVENT_NOTE_ON)
            begin_note(m, note, out);
        else if (event->type == CLAP_EVENT_NOTE_OFF)
            end_notes(m, note, &a);
        else
            choke(m, note, &a);
        return;
    case CLAP_EVENT_NOTE_EXPRESSION:
        if (event->size < sizeof *expression)
            return;
        a = (address){expression->note_id, expression->port_index, expression->channel, expression->key};
        if (possible(&a))
            express(m, expression, &a);
        return;
    case CLAP_EVENT_PARAM_VALUE:
        if (event->size >= sizeof *value)
            change(m, value, true);
        return;
    case CLAP_EVENT_TRANSPORT:
        if (event->size >= sizeof *transport)
            clap_transport(m, event->time, transport);
        return;
    case CLAP_EVENT_MIDI:
        if (event->size >= sizeof *midi)
            hear_midi(m, midi);
        return;
    case CLAP_EVENT_MIDI_SYSEX:
        if (event->size >= sizeof *sysex && sysex->buffer && sysex->port_index == 0)
            plugin_midi(m->p, event->time, sysex->buffer, sysex->size);
        return;
    default:
        return;
    }
}

void clap_flush(clap_instance *m, const clap_input_events_t *in, const clap_output_events_t *out) {
    (void)out; /* what the plugin changes by itself it tells with the next block */
    uint32_t count = in && in->size && in->get ? in->size(in) : 0;
    for (uint32_t i = 0; i < count; i++) {
        const clap_event_header_t *event = in->get(in, i);
        if (event && event->space_id == CLAP_CORE_EVENT_SPACE_ID && event->type == CLAP_EVENT_PARAM_VALUE &&
            event->size >= sizeof(clap_event_param_value_t))
            change(m, (const clap_event_param_value_t *)(const void *)event, false);
    }
}

/* ---- what the host is told ---- */

static void tell_ends(clap_instance *m, uint32_t frames, uint32_t time, const clap_output_events_t *out) {
    for (int32_t channel = 0; channel < CLAP_CHANNELS && m->notes.open; channel++)
        for (int32_t key = 0; key < CLAP_KEYS; key++) {
            clap_note *note = &m->notes.of[channel][key];
            if (!note->open)
                continue;
            if (note->age < SETTLED_FRAMES) {
                int64_t age = (int64_t)note->age + frames;
                note->age = age < 0 ? 0 : age < SETTLED_FRAMES ? (int32_t)age : SETTLED_FRAMES;
            }
            if (note->released && note->age >= SETTLED_FRAMES && !plugin_sounding(m->p, channel, key))
                tell_end(m, time, channel, key, out);
        }
}

static void tell_values(clap_instance *m, uint32_t time, const clap_output_events_t *out) {
    bool known = atomic_exchange(&m->loaded, false);
    for (uint32_t k = 0; k < plugin_parameters(m->p); k++) {
        double value = plugin_value(m->p, k);
        if (value == m->told[k])
            continue;
        clap_event_param_value_t event = {.header = {sizeof event, time, CLAP_CORE_EVENT_SPACE_ID, CLAP_EVENT_PARAM_VALUE, 0},
                                          .param_id = plugin_parameter_of(m->p, k)->stable_id, .note_id = -1,
                                          .port_index = -1, .channel = -1, .key = -1, .value = value};
        if (known || push(m, out, &event.header))
            m->told[k] = value;
    }
}

void clap_tell(clap_instance *m, uint32_t frames, const clap_output_events_t *out) {
    uint32_t time = frames ? frames - 1 : 0;
    if (m->notes.open)
        tell_ends(m, frames, time, out);
    tell_values(m, time, out);
}
