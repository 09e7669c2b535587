/* lv2.c: the plugin as LV2.
 *
 * Ports, as turtle.py writes them for the hosts: events in, left, right, latency, enabled, then a control for each parameter but
 * bypass, in the plugin's order, and for each of the setup an output that shows what is played. A control holds for a block: who wants it finer cuts blocks, as LV2 hosts do. What a control port
 * holds is a float: it is taken over only when it moves, and a parameter's initial value is meant where its float is given.
 */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "lv2_private.h"

enum { EVENTS, LEFT, RIGHT, LATENCY, ENABLED, FIRST_PARAMETER };

typedef struct lv2 {
    plugin *plugin;
    uint32_t parameters; /* that have ports */
    uint32_t bypass;     /* number of the parameter */
    bool ran;            /* since the last reset */
    double rate;
    const LV2_Log_Log *log; /* NULL: the host has none */
    LV2_URID error, midi, chunk, state;
    lv2_time time;
    const LV2_Atom_Sequence *events;
    float *left_right[2];
    float *latency;
    const float *enabled;
    const float **port; /* of each parameter, and what it held last */
    float **played;     /* of each of the setup, which are `setups` from number `first_setup` on */
    uint32_t first_setup, setups;
    float *held;
} lv2;

static LV2_Descriptor descriptor;

/* ---- life ---- */

static void *feature(const LV2_Feature *const *features, const char *uri) {
    for (; features && *features; features++)
        if (!strcmp((*features)->URI, uri)) return (*features)->data;
    return NULL;
}

/* What went wrong, where the host or who started it can read it. */
static void complain(const LV2_Log_Log *log, LV2_URID error, const char *why) {
    if (log)
        log->printf(log->handle, error, "%s: %s\n", descriptor.URI, why);
    else
        system_say("%s: %s", descriptor.URI, why);
}

static bool switch_on(lv2 *me, double rate, char *why) {
    const int32_t threads = plugin_wanted_threads();
    return plugin_activate(me->plugin, rate, threads ? threads : 1, false, why);
}

/* In a thread of the plugin's own: why another setup cannot be had. */
static void setup_changed(void *of) {
    const lv2 *me = of;
    char why[JAWARI_WHY];
    if (plugin_remark(me->plugin, why)) complain(me->log, me->error, why);
}

static void cleanup(LV2_Handle instance) {
    lv2 *me = instance;
    if (!me) return;
    plugin_free(me->plugin);
    free(me->port);
    free(me->played);
    free(me->held);
    free(me);
}

static LV2_Handle instantiate(const LV2_Descriptor *of, double rate, const char *bundle, const LV2_Feature *const *features) {
    (void)of;
    (void)bundle;
    char why[JAWARI_WHY] = "there is not enough memory";
    const LV2_URID_Map *map = feature(features, LV2_URID__map);
    if (!map) {
        complain(NULL, 0, "the host does not have the feature urid:map, without which LV2 plugins hear no MIDI");
        return NULL;
    }
    const LV2_Log_Log *log = feature(features, LV2_LOG__log);
    const LV2_URID error = map->map(map->handle, LV2_LOG__Error);
    lv2 *me = calloc(1, sizeof *me);
    if (me) me->plugin = plugin_new(why);
    if (!me || !me->plugin) goto failed;
    for (uint32_t k = 0; k < plugin_parameters(me->plugin); k++) {
        if (plugin_parameter_of(me->plugin, k)->bypass)
            me->bypass = k;
        else
            me->parameters++;
        if (plugin_parameter_of(me->plugin, k)->setup && me->setups++ == 0) me->first_setup = k;
    }
    me->played = calloc(me->setups + 1u, sizeof *me->played);
    me->log = log;
    me->error = error;
    plugin_when_changed(me->plugin, setup_changed, me);
    me->port = calloc(me->parameters + 1u, sizeof *me->port);
    me->held = calloc(me->parameters + 1u, sizeof *me->held);
    if (!me->port || !me->played || !me->held || !switch_on(me, rate, why)) goto failed;
    for (uint32_t k = 0; k < me->parameters; k++) me->held[k] = (float)plugin_value(me->plugin, k);
    me->rate = rate;
    me->midi = map->map(map->handle, LV2_MIDI__MidiEvent);
    me->chunk = map->map(map->handle, LV2_ATOM__Chunk);
    lv2_time_map(&me->time, map);
    char key[256];
    snprintf(key, sizeof key, "%s#state", descriptor.URI);
    me->state = map->map(map->handle, key);
    return me;
failed:
    complain(log, error, why);
    cleanup(me);
    return NULL;
}

static void connect_port(LV2_Handle instance, uint32_t port, void *at) {
    lv2 *me = instance;
    switch (port) {
    case EVENTS: me->events = at; break;
    case LEFT:
    case RIGHT: me->left_right[port - LEFT] = at; break;
    case LATENCY: me->latency = at; break;
    case ENABLED: me->enabled = at; break;
    default:
        port -= FIRST_PARAMETER;
        if (port < me->parameters)
            me->port[port] = at;
        else if (port - me->parameters < me->setups)
            me->played[port - me->parameters] = at;
    }
}

/* LV2 wants nothing to be left of what sounded before, but what was restored meanwhile has to come: a reset would take that up as
 * a block does, and then drop it. Another engine, for which LV2 gives the time here, finds it waiting. */
static void activate(LV2_Handle instance) {
    lv2 *me = instance;
    char why[JAWARI_WHY] = "there is not enough memory";
    if (me->ran && !switch_on(me, me->rate, why)) complain(me->log, me->error, why);
    me->ran = false;
}

/* ---- sound ---- */

static void controls(lv2 *me) {
    for (uint32_t k = 0; k < me->parameters; k++) {
        if (!me->port[k] || !isfinite(*me->port[k]) || *me->port[k] == me->held[k]) continue;
        const float given = me->held[k] = *me->port[k];
        if (given == (float)plugin_value(me->plugin, k)) continue; /* a state has set it, to more digits */
        const double initial = plugin_parameter_of(me->plugin, k)->initial;
        plugin_change(me->plugin, 0, k, given == (float)initial ? initial : (double)given);
    }
    /* the host's port says it alone: a state may have been saved in another host, which had it bypassed */
    const bool bypassed = me->enabled && *me->enabled <= 0.0f;
    if (bypassed != (plugin_value(me->plugin, me->bypass) > 0.0)) plugin_change(me->plugin, 0, me->bypass, bypassed);
}

static void events(lv2 *me) {
    const LV2_Atom_Sequence *all = me->events;
    if (!all || all->atom.size < sizeof *all - sizeof all->atom) return;
    const uint8_t *at = (const uint8_t *)(all + 1), *end = (const uint8_t *)&all->unit + all->atom.size;
    while ((size_t)(end - at) >= sizeof(LV2_Atom_Event)) {
        const LV2_Atom_Event *event = (const LV2_Atom_Event *)(const void *)at;
        const size_t size = event->body.size, room = (size_t)(end - at) - sizeof *event;
        if (size > room) return;
        if (event->body.type == me->midi)
            plugin_midi(me->plugin, event->frames, at + sizeof *event, size);
        else
            lv2_time_hear(&me->time, me->plugin, event->frames, &event->body);
        const size_t padded = (size + 7u) & ~(size_t)7u; /* events begin at multiples of eight bytes */
        if (padded > room) return;
        at += sizeof *event + padded;
    }
}

static void run(LV2_Handle instance, uint32_t frames) {
    lv2 *me = instance;
    if (me->latency) *me->latency = (float)plugin_latency(me->plugin);
    if (!me->left_right[0] || !me->left_right[1] || frames > INT32_MAX) return;
    controls(me);
    events(me);
    plugin_process(me->plugin, (int32_t)frames, me->left_right, NULL);
    for (uint32_t k = 0; k < me->setups; k++)
        if (me->played[k]) *me->played[k] = (float)plugin_played(me->plugin, me->first_setup + k);
    me->ran = true;
}

/* ---- state ---- */

static LV2_State_Status save(LV2_Handle instance, LV2_State_Store_Function store, void *handle, uint32_t flags,
                             const LV2_Feature *const *features) {
    (void)flags;
    (void)features;
    lv2 *me = instance;
    size_t size = 0;
    void *data = plugin_save(me->plugin, &size);
    if (!data) return LV2_STATE_ERR_NO_SPACE;
    const LV2_State_Status said = store(handle, me->state, data, size, me->chunk, LV2_STATE_IS_POD | LV2_STATE_IS_PORTABLE);
    free(data);
    return said;
}

static LV2_State_Status restore(LV2_Handle instance, LV2_State_Retrieve_Function retrieve, void *handle, uint32_t flags,
                                const LV2_Feature *const *features) {
    (void)flags;
    (void)features;
    lv2 *me = instance;
    size_t size = 0;
    LV2_URID type = 0;
    uint32_t stored = 0;
    const void *data = retrieve(handle, me->state, &size, &type, &stored);
    if (!data) return LV2_STATE_ERR_NO_PROPERTY;
    if (type != me->chunk) return LV2_STATE_ERR_BAD_TYPE;
    char why[JAWARI_WHY] = "";
    const bool loaded = plugin_load(me->plugin, data, size, why);
    if (!loaded || plugin_remark(me->plugin, why)) complain(me->log, me->error, why);
    return loaded ? LV2_STATE_SUCCESS : LV2_STATE_ERR_UNKNOWN;
}

static const void *extension_data(const char *uri) {
    static const LV2_State_Interface state = {save, restore};
    return strcmp(uri, LV2_STATE__interface) ? NULL : &state;
}

/* ---- the library's entry ---- */

static char uri[192];
static system_once described;

/* The bank gives the name; it is not kept open for it. */
static void describe(void) {
    char why[JAWARI_WHY] = "";
    jawari_bank *bank = jawari_open_own(why);
    if (!bank) {
        system_say("jawari: %s", why);
        return;
    }
    snprintf(uri, sizeof uri, "urn:jawari:%s", jawari_bank_id(bank));
    jawari_close(bank);
    descriptor = (LV2_Descriptor){uri, instantiate, connect_port, activate, run, NULL, cleanup, extension_data};
}

JAWARI_API const LV2_Descriptor *lv2_descriptor(uint32_t index) {
    system_do_once(&described, describe);
    return index == 0 && descriptor.URI ? &descriptor : NULL;
}
