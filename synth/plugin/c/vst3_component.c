/* vst3_component.c: an instance's life in a VST 3 host: buses, rates, on and off, states. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "vst3.h"

enum { MOST_STATE = 1 << 28 }; /* bytes that are read of what claims to be a state */

/* What went wrong, where who started the host can read it: VST 3 has no way to say it. */
static void complain(const vst3 *me, const char *why) {
    system_say("jawari (%s, VST3): %s", jawari_bank_id(plugin_bank(me->plugin)), why);
}

void vst3_setup_changed(void *of) {
    const vst3 *me = of;
    char why[JAWARI_WHY];
    if (plugin_remark(me->plugin, why)) complain(me, why);
}

tresult vst3_initialize(void *face, void *context) {
    (void)face;
    (void)context;
    return kResultOk;
}

static void switch_off(vst3 *me) {
    plugin_deactivate(me->plugin);
    free(me->nowhere);
    me->nowhere = NULL;
    me->on = me->ran = me->was_silent = false;
}

tresult vst3_terminate(void *face) {
    switch_off(vst3_of(face));
    return kResultOk;
}

tresult vst3_check_rate(const vst3 *me) {
    const jawari_bank *bank = plugin_bank(me->plugin);
    char why[JAWARI_WHY];
    int n = snprintf(why, sizeof why, "%g Hz is no sample rate of this plugin; it has", me->rate);
    for (int32_t k = 0; k < jawari_rates(bank); k++) {
        const double rate = jawari_rate_of(bank, k);
        if (rate == me->rate) return kResultOk;
        if (n > 0 && n < (int)sizeof why) n += snprintf(why + n, sizeof why - (size_t)n, "%s %g", k ? "," : "", rate);
    }
    complain(me, why);
    return kResultFalse;
}

/* ---- component ---- */

static tresult controller_class(void *face, TUID cid) {
    (void)face;
    (void)cid;
    return kNotImplemented; /* the controller is this very object */
}

static tresult io_mode(void *face, int32_t mode) {
    (void)face;
    (void)mode;
    return kNotImplemented;
}

static int32_t buses(void *face, int32_t media, int32_t direction) {
    (void)face;
    return (media == kAudio && direction == kOutput) || (media == kEvent && direction == kInput);
}

static tresult bus_info(void *face, int32_t media, int32_t direction, int32_t index, BusInfo *bus) {
    if (index != 0 || !buses(face, media, direction) || !bus) return kInvalidArgument;
    memset(bus, 0, sizeof *bus);
    bus->mediaType = media;
    bus->direction = direction;
    bus->channelCount = media == kAudio ? 2 : 16;
    vst3_wide(bus->name, 128, media == kAudio ? "Output" : "Notes");
    bus->busType = kMain;
    bus->flags = kDefaultActive;
    return kResultOk;
}

static tresult routing(void *face, void *in, void *out) {
    (void)face, (void)in, (void)out;
    return kNotImplemented;
}

static tresult activate_bus(void *face, int32_t media, int32_t direction, int32_t index, TBool on) {
    (void)on;
    return index == 0 && buses(face, media, direction) ? kResultOk : kInvalidArgument;
}

static tresult set_active(void *face, TBool on) {
    vst3 *me = vst3_of(face);
    switch_off(me);
    if (!on) return kResultOk;
    char why[JAWARI_WHY] = "there is not enough memory";
    const int32_t threads = plugin_wanted_threads();
    me->nowhere = malloc((2 * (size_t)me->most_frames + 1) * sizeof *me->nowhere);
    if (me->nowhere && plugin_activate(me->plugin, me->rate, threads ? threads : 1, false, why)) return kResultOk;
    switch_off(me);
    complain(me, why);
    return kResultFalse;
}

static tresult set_state(void *face, const IBStream **stream) {
    vst3 *me = vst3_of(face);
    if (!stream) return kInvalidArgument;
    uint8_t *data = NULL;
    size_t size = 0, room = 0;
    for (int32_t got = 1; got > 0 && size < MOST_STATE; size += (size_t)(got > 0 ? got : 0)) {
        if (size == room) {
            uint8_t *more = realloc(data, room = room ? 2 * room : 1 << 16);
            if (!more) {
                free(data);
                return kOutOfMemory;
            }
            data = more;
        }
        got = 0;
        if ((*stream)->read(stream, data + size, (int32_t)(room - size), &got) != kResultOk) got = 0;
        if ((size_t)(got > 0 ? got : 0) > room - size) got = 0;
    }
    char why[JAWARI_WHY] = "";
    const bool loaded = plugin_load(me->plugin, data, size, why);
    free(data);
    if (!loaded) {
        complain(me, why);
        return kResultFalse;
    }
    if (plugin_remark(me->plugin, why)) complain(me, why);
    vst3_show_all(me);
    return kResultOk;
}

static tresult get_state(void *face, const IBStream **stream) {
    vst3 *me = vst3_of(face);
    if (!stream) return kInvalidArgument;
    size_t size = 0;
    uint8_t *data = plugin_save(me->plugin, &size);
    if (!data || size > INT32_MAX) {
        free(data);
        return kOutOfMemory;
    }
    int32_t written = 0;
    for (size_t at = 0; at < size; at += (size_t)written) {
        written = 0;
        if ((*stream)->write(stream, data + at, (int32_t)(size - at), &written) != kResultOk || written <= 0) {
            free(data);
            return kResultFalse;
        }
    }
    free(data);
    return kResultOk;
}

const IComponent vst3_component = {
    VST3_COMMON,
    .initialize = vst3_initialize,
    .terminate = vst3_terminate,
    .getControllerClassId = controller_class,
    .setIoMode = io_mode,
    .getBusCount = buses,
    .getBusInfo = bus_info,
    .getRoutingInfo = routing,
    .activateBus = activate_bus,
    .setActive = set_active,
    .setState = set_state,
    .getState = get_state,
};
