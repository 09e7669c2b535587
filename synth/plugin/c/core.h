/* core.h: what the files of the core share. Private to it. */
#ifndef JAWARI_CORE_H
#define JAWARI_CORE_H

#include <stdatomic.h>
#include <stdbool.h>
#include "jawari.h"
#include "system.h"

/* ---- sentences ---- */

/* Into `why`, if there is one, cut to its room. */
#if defined(__GNUC__)
__attribute__((format(printf, 2, 3)))
#endif
void core_say(char *why, const char *format, ...);

/* ---- kernels (core_kernels.c) ---- */

typedef void core_function(void);

/* A table as emit.py writes it: functions of C's by their names in the sources. */
struct kernel {
    const char *name;
    core_function *address;
};
struct kernels {
    int64_t count;
    struct kernel list[];
};

/* Kernels for processors of a level and above (processor.h). */
struct core_level {
    const char *name;
    int least;
    const struct kernels *kernels;
};
/* What this library was made of, the levels from the plainest on: in a source that the build writes (library.py). */
struct core_made {
    const char *version;
    const char *marks; /* "jawari-kernels:…", its end, and another one, by which the file is known without being loaded */
    int32_t levels;
    struct core_level level[];
};
extern const struct core_made core_made;

/* What the core itself calls of those for this processor. */
struct core_calls {
    void (*process)(int64_t core, int64_t thread, int64_t events, int64_t count, int64_t out, int64_t frames, int64_t channels,
                    int64_t stems, int64_t parts, int64_t stem_frames, int64_t stem_channels);
    void (*attend)(int64_t core, int64_t thread, int64_t asleep);
    int64_t (*take)(int64_t core, int64_t thread);
    int64_t (*enable_ftz)(void);
    void (*restore)(int64_t control);
};

/* NULL, with `why`, where this processor is too old for all there are. */
const struct core_calls *core_kernels(char *why);
/* NULL: there is none of that name. */
core_function *core_find(const char *name);

/* ---- the bank (bank.c, of a file: bank_file.c); its records as bankfile.py writes them ---- */

struct bank_place {
    uint64_t at, stride, count;
};

enum {
    PLACE_CORE,
    PLACE_UNTIL,
    PLACE_LEFT,
    PLACE_SLEEPING,
    PLACE_ENDING,
    PLACE_WORKERS,
    PLACE_WAKE,
    PLACE_PENDING,
    PLACE_NOTES,
    PLACE_STOLEN,
    PLACE_DROPPED,
    PLACE_SILENCED,
    PLACE_PEAK,
    PLACE_UNPLAYED,
    PLACE_AWAKE,
    PLACE_IDLE,
    PLACE_SILENCED_STRINGS,
    PLACE_SILENCED_PARTS,
    PLACE_PROGRAMS,
    PLACE_PARAMETERS,
    PLACE_NOTE,
    PLACE_CHANNEL,
    PLACE_STILL,
    /* what an engine takes over from the one before it (core_follow.c) */
    PLACE_CHANNELS,
    PLACE_TUNING,
    PLACE_ZONES,
    PLACE_PART_CHANNEL,
    PLACE_PART_LEFT,
    PLACE_PART_RIGHT,
    PLACE_PART_HEIGHT,
    PLACES
};

struct bank_rate {
    double rate_hz;
    int64_t latency, tail, strings;
    uint64_t at, size, checksum;
    uint64_t constants_at, constants;
    uint64_t core_at, core_stored, core;
    uint64_t thread_at, thread_stored, thread;
    uint64_t relocations_at, relocations;
    uint64_t sounding, sounding_end;
    uint64_t thread_table, pitch;
    struct bank_place places[PLACES];
};

enum { TO_CONSTANT, TO_CORE, TO_THREAD, TO_FUNCTION };

struct bank_relocation {
    uint64_t word, target;
    uint32_t region, to;
};

struct jawari_bank {
    int64_t holds;       /* guarded by bank.c */
    system_map map;      /* of the file, where it is one */
    const uint8_t *data; /* the bank */
    const char *id, *name;
    const uint8_t *uid;
    int32_t presets, parameters, setup, rates, functions;
    jawari_preset *preset;
    jawari_parameter *parameter; /* live ones, then the setup */
    const struct bank_rate *rate;
    core_function **function;
    atomic_bool *sound;  /* of each rate, whether its block's checksum was found right */
    const struct drone_score *drone; /* NULL: it has none */
    uint32_t checksum;   /* of header and tables, which hold those of the blocks: tells banks apart */
};

/* A bank of bytes that stay, `room` of them, held once; NULL, with `why`, where they are none. name: where they are from. */
jawari_bank *bank_of_bytes(const uint8_t *bytes, uint64_t room, const char *name, char *why);
/* The library's own bank: opened where it is not open yet. */
jawari_bank *bank_own(jawari_bank *(*open)(char *why), char *why);
/* The file in which the library's own bank lies; NULL: it lies in none, or that is not known. */
const char *bank_own_file(void);
/* The record of a rate whose block can be used; NULL with `why`. */
const struct bank_rate *bank_block(jawari_bank *bank, double rate_hz, char *why);

/* ---- an engine (core.c) ---- */

enum { CORE_MOST_THREADS = 64, CORE_CHUNK = 512, CORE_EVENTS = 256 };

struct core_thread {
    uint8_t *memory;
    jawari_engine *engine;
    system_thread worker; /* if `started` */
    bool started;
    atomic_bool busy; /* a lent thread works on it */
};

struct jawari_engine {
    jawari_bank *bank;
    const struct bank_rate *rate;
    const struct core_calls *calls;
    const uint8_t *block;
    uint8_t *memory;  /* the core */
    int32_t threads;  /* the caller's included */
    system_tokens tokens; /* that wake workers */
    bool touched;        /* since it was silent something came that may sound */
    int64_t quiet;       /* frames since something sounded */
    atomic_bool working; /* a block is being computed */
    atomic_bool lent;    /* the host's threads help */
    double *fade;     /* what still fades from before a reset, interleaved */
    int32_t fade_frames, fade_at, fade_end;
    double mix[2 * CORE_CHUNK];
    jawari_event events[CORE_EVENTS];
    struct core_thread thread[CORE_MOST_THREADS];
};

/* The k-th word that a place names. */
static inline int64_t *core_word(const jawari_engine *engine, int place, uint64_t k) {
    const struct bank_place *p = &engine->rate->places[place];
    return (int64_t *)(void *)(engine->memory + p->at + k * p->stride);
}

/* ---- threads (core_threads.c) ---- */

/* As many workers as there are threads beside the caller's; fewer where there are none to be had. */
void core_start_workers(jawari_engine *engine);
void core_end_workers(jawari_engine *engine);

#endif
