/* plugin_drone.h: the drone of an instance, for the files plugin*.c. */
#ifndef JAWARI_PLUGIN_DRONE_H
#define JAWARI_PLUGIN_DRONE_H

#include "drone_score.h"

/* Where it is. Frames count from when the instance was switched on. */
typedef struct drone_place {
    double value[DRONE_PARAMETERS]; /* that it has been told */
    double position, width;         /* the part's, from which a stroke strays */
    double tempo;                   /* of the host, quarter notes a minute; NaN: not known */
    double beat;                    /* where the host is at the frame `beat_at`, in quarter notes; NaN: not known */
    int64_t beat_at;
    double anchor_s, anchor; /* at its own pace: from `origin` to the time of this place [cycles] */
    double tonic;            /* as the pegs stand [semitones] */
    int64_t now;             /* frame up to which it has played */
    int64_t origin;          /* frame at which it began */
    int64_t next;            /* number of the next stroke */
    int64_t turn;            /* frame at which the pegs are turned on; −1: they rest */
    int64_t held;            /* key of the string that was plucked last, −1 */
    int64_t playing;         /* 1: the host plays */
    int64_t running, locked; /* 1: it plucks; by the host's place */
    int64_t plucked;         /* 1: since it was silent */
    int64_t fresh;           /* 1: it is to see how things are before anything else */
} drone_place;

typedef struct plugin_drone {
    const struct drone_score *score; /* NULL: there is none */
    uint32_t first;                  /* number of its first parameter */
    drone_place place;
    double rate;
    jawari_event *events; /* the block's events, its own among them */
    int32_t room, count, strokes;
    int64_t begin, at; /* frames: of the block, and that it is at */
    double told_tempo; /* that comes with the next place */
} plugin_drone;

#endif
