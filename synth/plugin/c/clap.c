/* clap.c: the plugin for CLAP hosts: entry, factory, an instance's life. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "clap_private.h"
#include "system.h"

static clap_instance *me(const clap_plugin_t *self) { return self->plugin_data; }

/* An instance works alone on a few strings: waking other threads would take longer. */
enum { WORTH_HELPING = 4, MOST_LENT = 16 };

/* ---- an instance ---- */

static void log_as(const clap_instance *m, int32_t severity, const char *why) {
    if (m->host_log && m->host_log->log)
        m->host_log->log(m->host, severity, why);
    else
        system_say("jawari: %s", why);
}

static void say(const clap_instance *m, const char *why) { log_as(m, CLAP_LOG_ERROR, why); }

void clap_remark(const clap_instance *m) {
    char why[JAWARI_WHY];
    if (plugin_remark(m->p, why))
        log_as(m, CLAP_LOG_WARNING, why);
}

/* In a thread of the plugin's own: what is to be done on the main one is asked for. */
static void setup_changed(void *of) {
    const clap_instance *m = of;
    if (m->host->request_callback)
        m->host->request_callback(m->host);
}

static bool instance_init(const clap_plugin_t *self) {
    clap_instance *m = me(self);
    m->host_latency = m->host->get_extension(m->host, CLAP_EXT_LATENCY);
    m->host_params = m->host->get_extension(m->host, CLAP_EXT_PARAMS);
    m->host_pool = m->host->get_extension(m->host, CLAP_EXT_THREAD_POOL);
    m->host_log = m->host->get_extension(m->host, CLAP_EXT_LOG);
    char why[JAWARI_WHY];
    m->p = plugin_new(why);
    if (!m->p) {
        say(m, why);
        return false;
    }
    m->told = calloc(plugin_parameters(m->p), sizeof *m->told);
    if (!m->told) {
        say(m, "there is not enough memory for another instance");
        return false;
    }
    for (uint32_t k = 0; k < plugin_parameters(m->p); k++)
        m->told[k] = plugin_value(m->p, k);
    m->told_latency = -1;
    plugin_when_changed(m->p, setup_changed, m);
    return true;
}

static void instance_destroy(const clap_plugin_t *self) {
    clap_instance *m = me(self);
    plugin_free(m->p);
    free(m->told);
    free(m);
}

static bool instance_activate(const clap_plugin_t *self, double sample_rate, uint32_t min_frames, uint32_t max_frames) {
    (void)min_frames;
    (void)max_frames;
    clap_instance *m = me(self);
    int32_t threads = plugin_wanted_threads();
    bool pool = m->host_pool && m->host_pool->request_exec;
    if (threads == 0 && pool)
        threads = MOST_LENT;
    char why[JAWARI_WHY];
    if (!plugin_activate(m->p, sample_rate, threads, pool, why)) {
        say(m, why);
        return false;
    }
    m->lent = pool && plugin_threads(m->p) > 1;
    clap_forget_notes(m);
    bool known = m->told_latency < 0 || m->told_latency == plugin_latency(m->p);
    if (!known && m->host_latency && m->host_latency->changed)
        m->host_latency->changed(m->host);
    return true;
}

static void instance_deactivate(const clap_plugin_t *self) { plugin_deactivate(me(self)->p); }

static bool instance_start(const clap_plugin_t *self) {
    (void)self;
    return true;
}

static void instance_stop(const clap_plugin_t *self) { (void)self; }

static void instance_reset(const clap_plugin_t *self) {
    plugin_reset(me(self)->p);
    clap_forget_notes(me(self));
}

void clap_compute(clap_instance *m) {
    plugin_process(m->p, m->frames, m->is_wide ? NULL : m->narrow, m->is_wide ? m->wide : NULL);
}

static clap_process_status instance_process(const clap_plugin_t *self, const clap_process_t *process) {
    clap_instance *m = me(self);
    clap_audio_buffer_t *to = process->audio_outputs;
    if (!plugin_active(m->p) || process->audio_outputs_count < 1 || !to || to->channel_count < 2 ||
        (!to->data32 && !to->data64) || process->frames_count > INT32_MAX)
        return CLAP_PROCESS_ERROR;
    const clap_input_events_t *in = process->in_events;
    uint32_t count = in && in->size && in->get ? in->size(in) : 0;
    m->last_time = 0;
    clap_transport(m, 0, process->transport);
    for (uint32_t i = 0; i < count; i++)
        clap_hear(m, in->get(in, i), process->out_events);
    m->frames = (int32_t)process->frames_count;
    m->is_wide = !to->data32;
    for (int side = 0; side < 2; side++)
        if (m->is_wide)
            m->wide[side] = to->data64[side];
        else
            m->narrow[side] = to->data32[side];
    uint32_t threads = (uint32_t)plugin_threads(m->p);
    bool helped = m->lent && plugin_voices(m->p) >= WORTH_HELPING;
    if (!helped || !m->host_pool->request_exec(m->host, threads))
        clap_compute(m);
    to->constant_mask = 0;
    clap_tell(m, process->frames_count, process->out_events);
    return plugin_silent(m->p) ? CLAP_PROCESS_SLEEP : CLAP_PROCESS_CONTINUE;
}

static const void *instance_extension(const clap_plugin_t *self, const char *id) {
    (void)self;
    return clap_extension(id);
}

static void instance_on_main_thread(const clap_plugin_t *self) {
    const clap_instance *m = me(self);
    clap_remark(m);
    if (m->host_params && m->host_params->rescan)
        m->host_params->rescan(m->host, CLAP_PARAM_RESCAN_TEXT);
}

/* ---- what there is in this file: one plugin, its bank's ---- */

static struct {
    system_guard guard;
    int holds;
    jawari_bank *bank;
    char id[256], description[512];
    clap_plugin_descriptor_t descriptor;
} here;

static void describe(void) {
    static const char *const features[] = {"instrument", "synthesizer", "stereo", NULL};
    snprintf(here.id, sizeof here.id, "org.jawari.%s", jawari_bank_id(here.bank));
    if (jawari_presets(here.bank) == 1)
        snprintf(here.description, sizeof here.description, "%s", jawari_preset_of(here.bank, 0)->description);
    else
        snprintf(here.description, sizeof here.description, "Strings that collide with what lies under them: %d presets",
                 (int)jawari_presets(here.bank));
    here.descriptor = (clap_plugin_descriptor_t){.clap_version = CLAP_VERSION_INIT, .id = here.id,
                                                 .name = jawari_bank_name(here.bank), .vendor = "jawari", .url = "",
                                                 .manual_url = "", .support_url = "", .version = jawari_version(),
                                                 .description = here.description, .features = features};
}

static uint32_t factory_count(const clap_plugin_factory_t *factory) {
    (void)factory;
    return here.holds > 0;
}

static const clap_plugin_descriptor_t *factory_descriptor(const clap_plugin_factory_t *factory, uint32_t index) {
    return index < factory_count(factory) ? &here.descriptor : NULL;
}

static const clap_plugin_t *factory_create(const clap_plugin_factory_t *factory, const clap_host_t *host, const char *id) {
    if (!factory_count(factory) || !host || host->clap_version.major < 1 || !id || strcmp(id, here.id))
        return NULL;
    clap_instance *m = calloc(1, sizeof *m);
    if (!m)
        return NULL;
    m->host = host;
    m->clap = (clap_plugin_t){.desc = &here.descriptor, .plugin_data = m, .init = instance_init, .destroy = instance_destroy,
                              .activate = instance_activate, .deactivate = instance_deactivate, .start_processing = instance_start,
                              .stop_processing = instance_stop, .reset = instance_reset, .process = instance_process,
                              .get_extension = instance_extension, .on_main_thread = instance_on_main_thread};
    return &m->clap;
}

static const clap_plugin_factory_t FACTORY = {factory_count, factory_descriptor, factory_create};

static bool entry_init(const char *plugin_path) {
    (void)plugin_path; /* the bank stands behind the file that this code was loaded from */
    char why[JAWARI_WHY];
    system_lock(&here.guard);
    if (!here.bank) {
        here.bank = jawari_open_own(why);
        if (here.bank)
            describe();
        else
            system_say("jawari: %s", why);
    }
    bool there = here.bank != NULL;
    here.holds += there;
    system_unlock(&here.guard);
    return there;
}

static void entry_deinit(void) {
    system_lock(&here.guard);
    if (here.holds > 0 && --here.holds == 0) {
        jawari_close(here.bank);
        here.bank = NULL;
    }
    system_unlock(&here.guard);
}

static const void *entry_factory(const char *factory_id) {
    return factory_id && !strcmp(factory_id, CLAP_PLUGIN_FACTORY_ID) ? &FACTORY : NULL;
}

JAWARI_API const clap_plugin_entry_t clap_entry = {
    .clap_version = CLAP_VERSION_INIT, .init = entry_init, .deinit = entry_deinit, .get_factory = entry_factory};
