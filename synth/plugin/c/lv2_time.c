/* lv2_time.c: the transport of an LV2 host, which comes as objects among the events, where it changes. */
#include <math.h>
#include <string.h>

#include "lv2_private.h"

static const char *const KEYS[TIME_KEYS] = {LV2_TIME__bar, LV2_TIME__barBeat, LV2_TIME__beat, LV2_TIME__beatUnit,
                                            LV2_TIME__beatsPerBar, LV2_TIME__beatsPerMinute, LV2_TIME__speed};

void lv2_time_map(lv2_time *t, const LV2_URID_Map *map) {
    t->object = map->map(map->handle, LV2_ATOM__Object);
    t->blank = map->map(map->handle, LV2_ATOM__Blank);
    t->position = map->map(map->handle, LV2_TIME__Position);
    t->kind_float = map->map(map->handle, LV2_ATOM__Float);
    t->kind_double = map->map(map->handle, LV2_ATOM__Double);
    t->kind_int = map->map(map->handle, LV2_ATOM__Int);
    t->kind_long = map->map(map->handle, LV2_ATOM__Long);
    for (int k = 0; k < TIME_KEYS; k++) {
        t->key[k] = map->map(map->handle, KEYS[k]);
        t->said[k] = (double)NAN;
    }
}

/* The number that an atom holds; NaN: it is none. */
static double number(const lv2_time *t, const LV2_Atom *value) {
    const void *at = value + 1;
    if (value->type == t->kind_float && value->size >= sizeof(float)) {
        float x;
        memcpy(&x, at, sizeof x);
        return x;
    }
    if (value->type == t->kind_double && value->size >= sizeof(double)) {
        double x;
        memcpy(&x, at, sizeof x);
        return x;
    }
    if (value->type == t->kind_int && value->size >= sizeof(int32_t)) {
        int32_t x;
        memcpy(&x, at, sizeof x);
        return x;
    }
    if (value->type == t->kind_long && value->size >= sizeof(int64_t)) {
        int64_t x;
        memcpy(&x, at, sizeof x);
        return (double)x;
    }
    return (double)NAN;
}

/* LV2 counts in beats of the measure; the plugin in quarter notes. */
static void tell(const lv2_time *t, plugin *p, int64_t frame) {
    const double unit = t->said[TIME_BEAT_UNIT], quarters = unit > 0.0 ? 4.0 / unit : 1.0;
    double beat = t->said[TIME_BAR] * t->said[TIME_BEATS_PER_BAR] + t->said[TIME_BAR_BEAT];
    if (!isfinite(beat)) beat = t->said[TIME_BEAT];
    const double speed = t->said[TIME_SPEED];
    plugin_transport(p, frame, isfinite(speed) && speed != 0.0, quarters * beat, quarters * t->said[TIME_BEATS_PER_MINUTE]);
}

void lv2_time_hear(lv2_time *t, plugin *p, int64_t frame, const LV2_Atom *body) {
    if ((body->type != t->object && body->type != t->blank) || body->size < sizeof(LV2_Atom_Object) - sizeof(LV2_Atom)) return;
    const LV2_Atom_Object *object = (const LV2_Atom_Object *)(const void *)body;
    if (object->otype != t->position) return;
    t->said[TIME_BAR] = t->said[TIME_BAR_BEAT] = t->said[TIME_BEAT] = (double)NAN; /* an old place is none */
    const uint8_t *at = (const uint8_t *)(object + 1), *end = (const uint8_t *)(body + 1) + body->size;
    while ((size_t)(end - at) >= sizeof(LV2_Atom_Property)) {
        const LV2_Atom_Property *property = (const LV2_Atom_Property *)(const void *)at;
        const size_t room = (size_t)(end - at) - sizeof *property, size = property->value.size;
        if (size > room) break;
        for (int k = 0; k < TIME_KEYS; k++)
            if (property->key == t->key[k]) t->said[k] = number(t, &property->value);
        const size_t padded = (size + 7u) & ~(size_t)7u;
        if (padded > room) break;
        at += sizeof *property + padded;
    }
    tell(t, p, frame);
}
