/* clap_extensions.c: what a CLAP host may ask and set beside playing. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "clap_private.h"

/* A state larger than this is none. */
#define MOST_STATE ((size_t)1 << 29)

static clap_instance *me(const clap_plugin_t *self) { return self->plugin_data; }

static void name(char *to, size_t room, const char *from) { snprintf(to, room, "%s", from); }

/* ---- ports ---- */

static uint32_t audio_count(const clap_plugin_t *self, bool is_input) {
    (void)self;
    return is_input ? 0 : 1;
}

static bool audio_get(const clap_plugin_t *self, uint32_t index, bool is_input, clap_audio_port_info_t *info) {
    (void)self;
    if (is_input || index > 0)
        return false;
    *info = (clap_audio_port_info_t){.id = 0, .flags = CLAP_AUDIO_PORT_IS_MAIN | CLAP_AUDIO_PORT_SUPPORTS_64BITS,
                                     .channel_count = 2, .port_type = CLAP_PORT_STEREO, .in_place_pair = CLAP_INVALID_ID};
    name(info->name, sizeof info->name, "Output");
    return true;
}

static const clap_plugin_audio_ports_t AUDIO_PORTS = {audio_count, audio_get};

static uint32_t note_count(const clap_plugin_t *self, bool is_input) {
    (void)self;
    return is_input ? 1 : 0;
}

static bool note_get(const clap_plugin_t *self, uint32_t index, bool is_input, clap_note_port_info_t *info) {
    (void)self;
    if (!is_input || index > 0)
        return false;
    *info = (clap_note_port_info_t){
        .id = 0, .supported_dialects = CLAP_NOTE_DIALECT_CLAP | CLAP_NOTE_DIALECT_MIDI | CLAP_NOTE_DIALECT_MIDI_MPE,
        /* only these notes have ids, expressions and ends; pedals, bends and programs come as MIDI all the same */
        .preferred_dialect = CLAP_NOTE_DIALECT_CLAP};
    name(info->name, sizeof info->name, "Notes");
    return true;
}

static const clap_plugin_note_ports_t NOTE_PORTS = {note_count, note_get};

/* ---- parameters ---- */

static uint32_t params_count(const clap_plugin_t *self) { return plugin_parameters(me(self)->p); }

static bool params_info(const clap_plugin_t *self, uint32_t index, clap_param_info_t *info) {
    const plugin_parameter *q = plugin_parameter_of(me(self)->p, index);
    if (!q)
        return false;
    uint32_t stepped = q->stepped ? CLAP_PARAM_IS_STEPPED : 0, bypass = q->bypass ? CLAP_PARAM_IS_BYPASS : 0;
    uint32_t chosen = q->program || q->texts[0] ? CLAP_PARAM_IS_ENUM : 0;
    uint32_t turned = q->fixed ? CLAP_PARAM_IS_READONLY : q->setup ? 0 : CLAP_PARAM_IS_AUTOMATABLE;
    *info = (clap_param_info_t){.id = q->stable_id, .flags = turned | stepped | bypass | chosen,
                                .min_value = q->minimum, .max_value = q->maximum, .default_value = q->initial};
    name(info->name, sizeof info->name, q->name);
    snprintf(info->module, sizeof info->module, "%s%s", q->group, q->setup ? "/Setup" : "");
    return true;
}

static bool params_value(const clap_plugin_t *self, clap_id id, double *value) {
    int64_t k = plugin_find(me(self)->p, id);
    if (k >= 0)
        *value = plugin_value(me(self)->p, (uint32_t)k);
    return k >= 0;
}

static bool params_text(const clap_plugin_t *self, clap_id id, double value, char *text, uint32_t room) {
    int64_t k = plugin_find(me(self)->p, id);
    return k >= 0 && plugin_text(me(self)->p, (uint32_t)k, value, text, room);
}

static bool params_number(const clap_plugin_t *self, clap_id id, const char *text, double *value) {
    int64_t k = plugin_find(me(self)->p, id);
    return k >= 0 && plugin_number(me(self)->p, (uint32_t)k, text, value);
}

static void params_flush(const clap_plugin_t *self, const clap_input_events_t *in, const clap_output_events_t *out) {
    clap_flush(me(self), in, out);
}

static const clap_plugin_params_t PARAMS = {params_count, params_info, params_value, params_text, params_number, params_flush};

/* Whether it is neither a preset's, nor of its setup, nor of every plugin: a drone's. */
static bool is_drones(const plugin *p, uint32_t k) {
    const plugin_parameter *q = plugin_parameter_of(p, k);
    return q && q->part < 0 && !q->program && !q->bypass;
}

/* The drone's first parameter, or the end. */
static uint32_t first_of_drone(const plugin *p) {
    uint32_t k = 0;
    while (k < plugin_parameters(p) && !is_drones(p, k))
        k++;
    return k;
}

/* A page of knobs for every preset, and one for a drone. */
static uint32_t pages_count(const clap_plugin_t *self) {
    const plugin *p = me(self)->p;
    return (uint32_t)jawari_presets(plugin_bank(p)) + (first_of_drone(p) < plugin_parameters(p));
}

static bool pages_get(const clap_plugin_t *self, uint32_t index, clap_remote_controls_page_t *page) {
    const jawari_bank *bank = plugin_bank(me(self)->p);
    const plugin *p = me(self)->p;
    if (index >= pages_count(self))
        return false;
    const bool drone = index == (uint32_t)jawari_presets(bank);
    *page = (clap_remote_controls_page_t){.page_id = index};
    const char *title = drone ? "Drone" : jawari_preset_of(bank, (int32_t)index)->name;
    name(page->section_name, sizeof page->section_name, title);
    name(page->page_name, sizeof page->page_name, title);
    uint32_t filled = 0;
    for (int32_t k = 0; k < jawari_parameters(bank) && filled < CLAP_REMOTE_CONTROLS_COUNT; k++)
        if (jawari_parameter_of(bank, k)->part == (int32_t)index)
            page->param_ids[filled++] = plugin_parameter_of(me(self)->p, (uint32_t)k)->stable_id;
    for (uint32_t k = first_of_drone(p); drone && is_drones(p, k) && filled < CLAP_REMOTE_CONTROLS_COUNT; k++)
        page->param_ids[filled++] = plugin_parameter_of(p, k)->stable_id;
    while (filled < CLAP_REMOTE_CONTROLS_COUNT)
        page->param_ids[filled++] = CLAP_INVALID_ID;
    return true;
}

static const clap_plugin_remote_controls_t REMOTE_CONTROLS = {pages_count, pages_get};

/* ---- state ---- */

static bool state_save(const clap_plugin_t *self, const clap_ostream_t *stream) {
    size_t size, done = 0;
    uint8_t *data = plugin_save(me(self)->p, &size);
    while (data && done < size) {
        int64_t written = stream->write(stream, data + done, size - done);
        if (written <= 0 || (uint64_t)written > size - done)
            break;
        done += (size_t)written;
    }
    bool all = data && done == size;
    free(data);
    return all;
}

/* All that a stream holds; NULL: it failed, holds too much, or there is no memory. */
static uint8_t *read_all(const clap_istream_t *stream, size_t *size) {
    size_t room = 1 << 16, have = 0;
    uint8_t *data = malloc(room);
    while (data) {
        int64_t got = stream->read(stream, data + have, room - have);
        if (got == 0) {
            *size = have;
            return data;
        }
        if (got < 0 || (uint64_t)got > room - have || room > MOST_STATE)
            break;
        have += (size_t)got;
        if (have == room) {
            room *= 2;
            uint8_t *more = realloc(data, room);
            if (!more)
                break;
            data = more;
        }
    }
    free(data);
    return NULL;
}

static bool state_load(const clap_plugin_t *self, const clap_istream_t *stream) {
    clap_instance *m = me(self);
    size_t size = 0;
    uint8_t *data = read_all(stream, &size);
    char why[JAWARI_WHY] = "the host's stream of the state broke off, or memory is short";
    bool taken = data && plugin_load(m->p, data, size, why);
    free(data);
    if (!taken) {
        if (m->host_log && m->host_log->log)
            m->host_log->log(m->host, CLAP_LOG_ERROR, why);
        return false;
    }
    clap_remark(m);
    atomic_store(&m->loaded, true);
    if (m->host_params && m->host_params->rescan)
        m->host_params->rescan(m->host, CLAP_PARAM_RESCAN_VALUES);
    if (plugin_active(m->p)) /* it may be asleep, and sound from now on */
        m->host->request_process(m->host);
    return true;
}

static const clap_plugin_state_t STATE = {state_save, state_load};

/* ---- times, voices, threads ---- */

static uint32_t latency_get(const clap_plugin_t *self) {
    me(self)->told_latency = plugin_latency(me(self)->p);
    return (uint32_t)me(self)->told_latency;
}

static const clap_plugin_latency_t LATENCY = {latency_get};

static uint32_t tail_get(const clap_plugin_t *self) {
    int64_t tail = plugin_tail(me(self)->p);
    return tail < INT32_MAX ? (uint32_t)tail : INT32_MAX;
}

static const clap_plugin_tail_t TAIL = {tail_get};

static bool render_realtime(const clap_plugin_t *self) {
    (void)self;
    return false;
}

static bool render_set(const clap_plugin_t *self, int32_t mode) {
    (void)self;
    (void)mode; /* it sounds the same */
    return true;
}

static const clap_plugin_render_t RENDER = {render_realtime, render_set};

static bool voice_get(const clap_plugin_t *self, clap_voice_info_t *info) {
    uint32_t strings = (uint32_t)jawari_strings(plugin_bank(me(self)->p));
    *info = (clap_voice_info_t){.voice_count = strings, .voice_capacity = strings};
    return true;
}

static const clap_plugin_voice_info_t VOICE_INFO = {voice_get};

static void pool_exec(const clap_plugin_t *self, uint32_t task_index) {
    if (task_index == 0)
        clap_compute(me(self));
    else
        plugin_help(me(self)->p, (int32_t)task_index);
}

static const clap_plugin_thread_pool_t THREAD_POOL = {pool_exec};

const void *clap_extension(const char *id) {
    static const struct {
        const char *id;
        const void *extension;
    } known[] = {
        {CLAP_EXT_AUDIO_PORTS, &AUDIO_PORTS},
        {CLAP_EXT_NOTE_PORTS, &NOTE_PORTS},
        {CLAP_EXT_PARAMS, &PARAMS},
        {CLAP_EXT_STATE, &STATE},
        {CLAP_EXT_LATENCY, &LATENCY},
        {CLAP_EXT_TAIL, &TAIL},
        {CLAP_EXT_RENDER, &RENDER},
        {CLAP_EXT_VOICE_INFO, &VOICE_INFO},
        {CLAP_EXT_THREAD_POOL, &THREAD_POOL},
        {CLAP_EXT_REMOTE_CONTROLS, &REMOTE_CONTROLS},
        {CLAP_EXT_REMOTE_CONTROLS_COMPAT, &REMOTE_CONTROLS},
    };
    for (size_t k = 0; id && k < sizeof known / sizeof *known; k++)
        if (!strcmp(id, known[k].id))
            return known[k].extension;
    return NULL;
}
