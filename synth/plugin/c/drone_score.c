/* drone_score.c: whether a bank's drone can be played, looked at before anything of it is used. */
#include <math.h>
#include <string.h>

#include "drone_score.h"

_Static_assert(sizeof(struct drone_score) == 160, "as droning.SCORE");
_Static_assert(sizeof(struct drone_parameter) == 288, "as droning.OWN");
_Static_assert(sizeof(struct drone_stroke) == 40, "as droning.STROKE");

enum { MOST_STROKES = 1 << 24, MOST_STEPS = 128, MOST_INDEX = 63 };

static bool between(double low, double x, double high) { return low <= x && x <= high; }

static bool parameter_fits(const struct drone_parameter *q) {
    bool fits = isfinite(q->minimum) && isfinite(q->maximum) && q->minimum < q->maximum &&
                between(q->minimum, q->initial, q->maximum) && q->curve >= JAWARI_LINEAR && q->curve <= JAWARI_SQUARE;
    fits = fits && *q->id && memchr(q->id, 0, sizeof q->id) && memchr(q->name, 0, sizeof q->name) &&
           memchr(q->unit, 0, sizeof q->unit);
    for (int k = 0; fits && k < DRONE_TEXTS; k++)
        fits = memchr(q->texts[k], 0, sizeof q->texts[k]) != NULL;
    /* each whole number of those that have texts has one */
    return fits && (!*q->texts[0] || (q->stepped && between(0.0, q->minimum, 0.0) && q->maximum < (double)DRONE_TEXTS));
}

bool drone_score_fits(const struct drone_score *s, uint64_t size, uint32_t presets) {
    if (size < sizeof *s || s->strings < 1 || s->strings > DRONE_STRINGS || s->strokes < s->strings ||
        s->strokes > MOST_STROKES || s->strokes % s->strings != 0 || s->parameters != DRONE_PARAMETERS || s->steps < 1 ||
        s->steps > MOST_STEPS)
        return false;
    if (size != sizeof *s + s->parameters * sizeof(struct drone_parameter) + (uint64_t)s->steps * s->strings * sizeof(double) +
                    s->strokes * sizeof(struct drone_stroke))
        return false;
    if (s->part < 0 || (uint32_t)s->part >= presets || s->channel < 0 || s->channel > 15 || s->position < 0 ||
        s->position > MOST_INDEX || s->width < 0 || s->width > MOST_INDEX)
        return false;
    if (!between(-128.0, s->step_low, 128.0) || !between(0.0, s->lead_s, 60.0) || !between(1e-3, s->semitone_s, 60.0) ||
        !between(1e-3, s->step_s, 60.0))
        return false;
    for (uint32_t k = 0; k < s->strings; k++)
        if (s->keys[k] < 0 || s->keys[k] > 127 || !(s->places[k] >= (k ? s->places[k - 1] : 0.0) && s->places[k] < 1.0))
            return false;
    for (uint32_t k = 0; k < s->parameters; k++)
        if (!parameter_fits(drone_parameter_of(s, k)))
            return false;
    if (drone_parameter_of(s, DRONE_SECONDS)->minimum < 0.01 || drone_parameter_of(s, DRONE_BEATS)->minimum < 0.25 ||
        drone_parameter_of(s, DRONE_TONIC)->minimum < s->step_low ||
        drone_parameter_of(s, DRONE_TONIC)->maximum > s->step_low + (double)(s->steps - 1))
        return false;
    for (uint32_t k = 0; k < s->steps * s->strings; k++)
        if (!between(-128.0, drone_pitches(s, 0)[k], 256.0))
            return false;
    for (uint32_t k = 0; k < s->strokes; k++) {
        const struct drone_stroke *x = drone_stroke_of(s, k);
        if (!between(-0.5, x->sway, 0.5) || !between(-0.5, x->wander, 0.5) || !between(0.0, x->louder, 100.0) ||
            !between(-1.0, x->farther, 1.0) || !between(0.0, x->wider, 100.0))
            return false;
    }
    return true;
}
