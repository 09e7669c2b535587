/* An engine that goes on where one of another bank of the same presets leaves off: what was set, but nothing that sounds. */
#include <string.h>
#include "core.h"

/* Words that a place names, as far as both engines have them. */
static void copy(jawari_engine *engine, const jawari_engine *from, int place) {
    const struct bank_place *mine = &engine->rate->places[place], *theirs = &from->rate->places[place];
    for (uint64_t k = 0; k < mine->count && k < theirs->count; k++)
        *core_word(engine, place, k) = *core_word(from, place, k);
}

/* Rows of words: as many as lie from one to the next. */
static void copy_rows(jawari_engine *engine, const jawari_engine *from, int place) {
    const struct bank_place *mine = &engine->rate->places[place], *theirs = &from->rate->places[place];
    const uint64_t stride = mine->stride < theirs->stride ? mine->stride : theirs->stride;
    for (uint64_t k = 0; k < mine->count && k < theirs->count; k++)
        memcpy(core_word(engine, place, k), core_word(from, place, k), (size_t)stride);
}

/* Keys that were tuned keep their pitches: in a bank of another concert pitch these are other distances. */
static void copy_tuning(jawari_engine *engine, const jawari_engine *from) {
    for (int32_t key = 0; key < 128; key++) {
        double above;
        memcpy(&above, core_word(from, PLACE_TUNING, (uint64_t)key), sizeof above);
        if (above != 0.0)
            above += jawari_pitch(from, key) - jawari_pitch(engine, key);
        memcpy(core_word(engine, PLACE_TUNING, (uint64_t)key), &above, sizeof above);
    }
}

int32_t jawari_waiting(const jawari_engine *engine) { return *core_word(engine, PLACE_PENDING, 0) != 0; }

void jawari_follow(jawari_engine *engine, const jawari_engine *from) {
    static const int places[] = {PLACE_CHANNELS,  PLACE_ZONES,      PLACE_PART_CHANNEL,
                                 PLACE_PART_LEFT, PLACE_PART_RIGHT, PLACE_PART_HEIGHT};
    for (size_t k = 0; k < sizeof places / sizeof *places; k++)
        copy(engine, from, places[k]);
    copy_rows(engine, from, PLACE_PARAMETERS);
    copy_tuning(engine, from);
    engine->touched = true;
    engine->quiet = 0;
}
