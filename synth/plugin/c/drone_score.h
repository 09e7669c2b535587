/* drone_score.h: what a bank says of the drone that its plugin plays by itself, as droning.py writes it.
 *
 * Behind the score lie `parameters` records, `steps` rows of `strings` pitches (semitones of the keys, for each semitone that the
 * tonic is turned by), and `strokes` variations, after which they begin anew.
 */
#ifndef JAWARI_DRONE_SCORE_H
#define JAWARI_DRONE_SCORE_H

#include <stdbool.h>
#include <stdint.h>

#include "jawari.h"

enum { DRONE_STRINGS = 8, DRONE_TEXTS = 3 };
/* Its parameters, and the values of the first two. */
enum { DRONE_MODE, DRONE_PACE, DRONE_SECONDS, DRONE_BEATS, DRONE_VELOCITY, DRONE_TONIC, DRONE_PARAMETERS };
enum { DRONE_OFF, DRONE_ON, DRONE_WITH_HOST };
enum { DRONE_OWN_PACE, DRONE_HOST_PACE };

struct drone_score {
    uint32_t strings, strokes, parameters, steps;
    int32_t part, channel;
    int32_t position, width; /* indices of the part's live parameters that a stroke varies */
    double step_low;         /* semitones of the first step */
    double lead_s;           /* before the first stroke */
    double semitone_s, step_s; /* pegs turn by a semitone in this time, in steps of that */
    int32_t keys[DRONE_STRINGS];
    double places[DRONE_STRINGS]; /* in the cycle */
};

struct drone_parameter {
    double minimum, maximum, initial;
    int32_t curve, stepped;
    char id[48], name[96], unit[16], texts[DRONE_TEXTS][32];
};

/* How the hand strays at a stroke: from its place [cycles], which the grid does by `wander` of it; factors of velocity and width
 * of the finger, and how much farther the string is plucked. */
struct drone_stroke {
    double sway, wander, louder, farther, wider;
};

/* Whether so many bytes are a score for a bank of so many presets. */
bool drone_score_fits(const struct drone_score *score, uint64_t size, uint32_t presets);

static inline const struct drone_parameter *drone_parameter_of(const struct drone_score *score, uint32_t k) {
    return (const struct drone_parameter *)(const void *)(score + 1) + k;
}
static inline const double *drone_pitches(const struct drone_score *score, uint32_t step) {
    return (const double *)(const void *)drone_parameter_of(score, score->parameters) + (uint64_t)step * score->strings;
}
static inline const struct drone_stroke *drone_stroke_of(const struct drone_score *score, uint64_t k) {
    return (const struct drone_stroke *)(const void *)drone_pitches(score, score->steps) + k;
}

/* NULL: the bank has none. */
const struct drone_score *bank_drone(const jawari_bank *bank);

#endif
