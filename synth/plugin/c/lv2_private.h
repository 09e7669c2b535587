/* lv2_private.h: for the files lv2*.c. */
#ifndef JAWARI_LV2_PRIVATE_H
#define JAWARI_LV2_PRIVATE_H

#include "lv2_api.h"
#include "plugin.h"
#include "system.h"

enum { TIME_BAR, TIME_BAR_BEAT, TIME_BEAT, TIME_BEAT_UNIT, TIME_BEATS_PER_BAR, TIME_BEATS_PER_MINUTE, TIME_SPEED, TIME_KEYS };

/* The host's transport: numbers of what is read, and what was said last; NaN: nothing. */
typedef struct lv2_time {
    LV2_URID object, blank, position, kind_float, kind_double, kind_int, kind_long;
    LV2_URID key[TIME_KEYS];
    double said[TIME_KEYS];
} lv2_time;

void lv2_time_map(lv2_time *t, const LV2_URID_Map *map);
/* Take up an event that is a time:Position, with `body->size` bytes behind it; others are passed over. */
void lv2_time_hear(lv2_time *t, plugin *p, int64_t frame, const LV2_Atom *body);

#endif
