/* plugin.c: an instance's life, and its parameters. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "plugin_rebuild.h"

enum { MOST_THREADS = 16 };

void plugin_copy_text(char *to, size_t room, const char *from) {
    size_t length = strlen(from);
    if (room == 0)
        return;
    if (length >= room) {
        length = room - 1;
        while (length > 0 && ((uint8_t)from[length] & 0xC0) == 0x80)
            length--;
    }
    memcpy(to, from, length);
    to[length] = 0;
}

/* FNV-1a, in the range that every format has for parameters. */
static uint32_t stable_id_of(const char *id) {
    uint32_t hash = 2166136261u;
    for (; *id; id++)
        hash = (hash ^ (uint8_t)*id) * 16777619u;
    return hash % 0x7FFF0000u;
}

static void describe_own(plugin *p, uint32_t k, const char *id, const char *name, double maximum) {
    plugin_parameter *q = &p->parameters[k];
    plugin_copy_text(q->id, sizeof q->id, id);
    plugin_copy_text(q->name, sizeof q->name, name);
    q->stable_id = stable_id_of(q->id);
    q->maximum = maximum;
    q->stepped = true;
    q->curve = JAWARI_LINEAR;
    q->part = -1;
}

/* A parameter of a preset. */
static void describe_preset(plugin *p, uint32_t k, const jawari_parameter *from) {
    const jawari_preset *preset = jawari_preset_of(p->bank, from->part);
    plugin_parameter *q = &p->parameters[k];
    char id[2 * sizeof q->id];
    snprintf(id, sizeof id, "%s/%s", preset->id, from->id);
    plugin_copy_text(q->id, sizeof q->id, id);
    plugin_copy_text(q->name, sizeof q->name, from->name);
    plugin_copy_text(q->group, sizeof q->group, preset->name);
    plugin_copy_text(q->unit, sizeof q->unit, from->unit);
    q->stable_id = stable_id_of(q->id);
    q->minimum = from->minimum;
    q->maximum = from->maximum;
    q->initial = from->initial;
    q->curve = from->curve;
    q->part = from->part;
}

static void describe_drone(plugin *p, uint32_t k, const struct drone_parameter *from) {
    plugin_parameter *q = &p->parameters[k];
    describe_own(p, k, from->id, from->name, from->maximum);
    plugin_copy_text(q->group, sizeof q->group, "Drone");
    plugin_copy_text(q->unit, sizeof q->unit, from->unit);
    q->minimum = from->minimum;
    q->initial = from->initial;
    q->stepped = from->stepped != 0;
    q->curve = from->curve;
    for (int text = 0; text < DRONE_TEXTS && *from->texts[0]; text++)
        q->texts[text] = from->texts[text];
}

static bool describe(plugin *p, char *why) {
    for (uint32_t k = 0; k < p->of_presets; k++) {
        const jawari_parameter *from = jawari_parameter_of(p->bank, (int32_t)k);
        p->targets[k] = (plugin_target){from->part, from->index};
        describe_preset(p, k, from);
    }
    for (uint32_t k = p->of_presets; plugin_is_setup(p, k); k++) {
        describe_preset(p, k, jawari_setup_number_of(p->bank, (int32_t)(k - p->of_presets)));
        p->parameters[k].setup = true;
    }
    uint32_t k = p->of_presets + p->setups;
    p->program = -1;
    if (jawari_presets(p->bank) > 1) {
        p->program = k;
        p->parameters[k].program = true;
        describe_own(p, k++, "program", "Program", jawari_presets(p->bank) - 1);
    }
    p->drone.first = k;
    for (uint32_t i = 0; p->drone.score && i < DRONE_PARAMETERS; i++)
        describe_drone(p, k++, drone_parameter_of(p->drone.score, i));
    p->bypass = k;
    describe_own(p, k, "bypass", "Bypass", 1.0);
    p->parameters[k].bypass = true;
    for (uint32_t i = 0; i < p->count; i++)
        for (uint32_t j = 0; j < i; j++)
            if (p->parameters[i].stable_id == p->parameters[j].stable_id) {
                if (why)
                    snprintf(why, JAWARI_WHY,
                             "the parameters %s and %s cannot be told apart by a host; give one of the presets another id",
                             p->parameters[j].id, p->parameters[i].id);
                return false;
            }
    return true;
}

static size_t room_for_events(const plugin *p) { return (size_t)p->before + PLUGIN_EVENTS + PLUGIN_LETTING_GO; }

plugin *plugin_new(char *why) {
    jawari_bank *bank = jawari_open_own(why);
    if (!bank)
        return NULL;
    plugin *p = calloc(1, sizeof *p);
    if (!p) {
        jawari_close(bank);
        if (why)
            snprintf(why, JAWARI_WHY, "there is not enough memory for another instance");
        return NULL;
    }
    p->bank = bank;
    p->latency = -1;
    p->threads = 1;
    p->of_presets = (uint32_t)jawari_parameters(bank);
    p->setups = (uint32_t)jawari_setup_numbers(bank);
    p->drone.score = bank_drone(bank);
    p->count = p->of_presets + p->setups + (jawari_presets(bank) > 1 ? 2 : 1) + (p->drone.score ? DRONE_PARAMETERS : 0);
    /* every value may have to be told, the program to every channel, and all notes be let go */
    p->before = (int32_t)p->count + PLUGIN_CHANNELS + PLUGIN_LETTING_GO;
    p->parameters = calloc(p->count, sizeof *p->parameters);
    p->targets = calloc(p->count, sizeof *p->targets);
    p->values = calloc(p->count, sizeof *p->values);
    p->sent = calloc(p->count, sizeof *p->sent);
    p->events = calloc(room_for_events(p), sizeof *p->events);
    p->sorting = calloc(PLUGIN_EVENTS, sizeof *p->sorting);
    p->drone.room = p->drone.score ? plugin_drone_room((int32_t)room_for_events(p)) : 0;
    p->drone.events = calloc((size_t)p->drone.room + 1, sizeof *p->drone.events);
    bool made = p->parameters && p->targets && p->values && p->sent && p->events && p->sorting && p->drone.events;
    if (!made && why)
        snprintf(why, JAWARI_WHY, "there is not enough memory for another instance");
    if (!made || !describe(p, why)) {
        plugin_free(p);
        return NULL;
    }
    for (uint32_t k = 0; k < p->count; k++)
        plugin_store(p, k, p->parameters[k].initial);
    if (!plugin_rebuild_new(p)) {
        if (why)
            snprintf(why, JAWARI_WHY, "there is not enough memory for another instance");
        plugin_free(p);
        return NULL;
    }
    for (uint32_t k = 0; k < p->count; k++)
        p->parameters[k].fixed = p->parameters[k].setup && !plugin_rebuild_possible(p);
    plugin_begin_anew(p, 0);
    return p;
}

void plugin_free(plugin *p) {
    if (!p)
        return;
    plugin_deactivate(p);
    plugin_rebuild_free(p);
    jawari_close(p->bank);
    free(p->parameters);
    free(p->targets);
    free(p->values);
    free(p->sent);
    free(p->events);
    free(p->sorting);
    free(p->drone.events);
    free(p);
}

const jawari_bank *plugin_bank(const plugin *p) { return p->bank; }

uint32_t plugin_parameters(const plugin *p) { return p->count; }

const plugin_parameter *plugin_parameter_of(const plugin *p, uint32_t k) { return k < p->count ? &p->parameters[k] : NULL; }

int64_t plugin_find(const plugin *p, uint32_t stable_id) {
    for (uint32_t k = 0; k < p->count; k++)
        if (p->parameters[k].stable_id == stable_id)
            return k;
    return -1;
}

int64_t plugin_named(const plugin *p, const char *id, size_t length) {
    for (uint32_t k = 0; k < p->count; k++)
        if (strlen(p->parameters[k].id) == length && !memcmp(p->parameters[k].id, id, length))
            return k;
    return -1;
}

/* ---- values ---- */

double plugin_kept(const plugin_parameter *q, double value) {
    value = fmin(fmax(value, q->minimum), q->maximum);
    return q->stepped ? floor(value + 0.5) : value;
}

double plugin_value(const plugin *p, uint32_t k) {
    if (k >= p->count)
        return 0.0;
    uint64_t bits = atomic_load_explicit(&p->values[k], memory_order_relaxed);
    double value;
    memcpy(&value, &bits, sizeof value);
    return value;
}

void plugin_store(plugin *p, uint32_t k, double value) {
    uint64_t bits;
    memcpy(&bits, &value, sizeof bits);
    atomic_store_explicit(&p->values[k], bits, memory_order_relaxed);
}

void plugin_set(plugin *p, uint32_t k, double value) {
    if (k >= p->count || !isfinite(value) || p->parameters[k].fixed)
        return;
    plugin_store(p, k, plugin_kept(&p->parameters[k], value));
    if (p->parameters[k].setup)
        plugin_rebuild_wish(p);
}

/* ---- sound on and off ---- */

int32_t plugin_wanted_threads(void) {
    const char *wanted = system_variable("JAWARI_THREADS");
    if (!wanted || !*wanted)
        return 0;
    char *end;
    long count = strtol(wanted, &end, 10);
    if (*end || count < 1)
        return 1;
    return count > MOST_THREADS ? MOST_THREADS : (int32_t)count;
}

bool plugin_activate(plugin *p, double rate_hz, int32_t threads, bool host_threads, char *why) {
    plugin_deactivate(p);
    threads = threads < 1 ? 1 : threads > MOST_THREADS ? MOST_THREADS : threads;
    jawari_engine *engine = plugin_rebuild_create(p, rate_hz, threads, host_threads, why);
    if (!engine)
        return false;
    system_lock(&p->guard);
    p->engine = engine;
    p->threads = jawari_threads(engine);
    p->latency = jawari_latency(engine);
    p->tail = jawari_tail(engine);
    p->gain_step = 1.0 / (0.005 * rate_hz);
    /* memory that is written for the first time is fetched from the system: now, not by the audio thread */
    memset(p->events, 0, room_for_events(p) * sizeof *p->events);
    memset(p->sorting, 0, PLUGIN_EVENTS * sizeof *p->sorting);
    memset(p->drone.events, 0, (size_t)p->drone.room * sizeof *p->drone.events);
    plugin_begin_anew(p, INT64_MAX / 2);
    p->drone.rate = rate_hz;
    system_unlock(&p->guard);
    plugin_rebuild_begin(p);
    return true;
}

void plugin_deactivate(plugin *p) {
    plugin_rebuild_end(p);
    jawari_destroy(atomic_exchange(&p->engine, NULL));
    p->threads = 1;
}

bool plugin_active(const plugin *p) { return p->engine != NULL; }

int32_t plugin_threads(const plugin *p) { return p->threads; }

/* Latency and tail before there is an engine: those of one that is made to be asked. */
static void measure(const plugin *p) {
    plugin *mine = (plugin *)(uintptr_t)p; /* what is remembered here changes nothing that can be seen */
    system_lock(&mine->guard);
    if (p->latency < 0) {
        jawari_engine *engine = jawari_create(p->bank, jawari_rate_of(p->bank, 0), 1, NULL);
        mine->latency = engine ? jawari_latency(engine) : 0;
        mine->tail = engine ? jawari_tail(engine) : 0;
        jawari_destroy(engine);
    }
    system_unlock(&mine->guard);
}

int32_t plugin_latency(const plugin *p) {
    if (!p->engine && p->latency < 0)
        measure(p);
    return p->latency;
}

int64_t plugin_tail(const plugin *p) {
    if (!p->engine && p->latency < 0)
        measure(p);
    return p->tail + p->latency;
}
