/* plugin_private.h: an instance from the inside, for the files plugin*.c.
 *
 * Who may touch what: what is atomic belongs to all, what stands under "audio thread" to that one. All else is guarded by `guard`,
 * which the audio thread never takes.
 */
#ifndef JAWARI_PLUGIN_PRIVATE_H
#define JAWARI_PLUGIN_PRIVATE_H

#include <stdatomic.h>

#include "plugin.h"
#include "plugin_drone.h"
#include "system.h"

enum {
    PLUGIN_EVENTS = 8192,  /* gathered in one block at most */
    PLUGIN_CHANNELS = 16,
    PLUGIN_KEYS = 128,
    PLUGIN_LETTING_GO = 2 * PLUGIN_CHANNELS, /* events that let all notes go */
    PLUGIN_NOTHING = 0,    /* kind of an event that was taken out */
    /* kinds of events that the engine does not know: */
    PLUGIN_BYPASS = 1000,  /* `a` 1: bypassed from this frame on */
    PLUGIN_DRONE = 1001,   /* parameter `a` of the drone's has this value */
    PLUGIN_TEMPO = 1002,   /* value: of the host; it counts with the place that follows */
    PLUGIN_PLACE = 1003    /* `a` 1: the host plays; value: where, in quarter notes */
};

/* The pitches of the keys as the instance has set them: by tunings, and by what is said of single notes. */
typedef struct plugin_pitches {
    double tuned[PLUGIN_KEYS]; /* as a TUNING event has it; NaN: as compiled */
    uint8_t bent[PLUGIN_KEYS]; /* 1: a note is off this pitch, to be taken back before the next one */
} plugin_pitches;

typedef struct plugin_target {
    int32_t part, index; /* of a preset's parameter */
} plugin_target;

struct plugin {
    jawari_bank *bank;
    uint32_t count;
    uint32_t of_presets; /* parameters that are a preset's; then come those of the setup, then the plugin's own */
    uint32_t setups;
    struct plugin_rebuild *rebuild;
    int64_t program, bypass; /* numbers of these two; −1: there is none */
    plugin_parameter *parameters;
    plugin_target *targets;
    _Atomic uint64_t *values; /* bits of a double */

    system_guard guard;
    _Atomic(jawari_engine *) engine; /* changed only while no audio thread runs, and by that one (plugin_rebuild.c) */
    int32_t threads;
    int32_t latency; /* −1: not known yet */
    _Atomic int64_t tail;

    atomic_bool loaded; /* a state: what sounds is to fade, and all values to be told anew */

    /* audio thread */
    bool in_block;
    double *sent; /* values that the engine has been told */
    plugin_pitches pitches;
    jawari_event *events; /* room for those that go before the gathered ones, the gathered, and those after them */
    jawari_event *sorting; /* room for the gathered ones, while they are put in order */
    int32_t before, gathered;
    bool disordered; /* they came in another order than that of their frames */
    bool lost; /* more came than there is room for */
    bool late; /* values found no room: they are told with the next block */
    bool owed; /* the engine had no room for all: the next block begins with the end of all notes */
    bool bypassed;
    double gain, gain_step; /* of the bypass */
    plugin_drone drone;
    int64_t quiet;          /* frames since anything was heard */
};

/* Whether it is a number of the setup: the engine does not hear of it. */
static inline bool plugin_is_setup(const plugin *p, uint32_t k) { return k >= p->of_presets && k - p->of_presets < p->setups; }

/* A parameter's value, brought into its range. */
double plugin_kept(const plugin_parameter *q, double value);
void plugin_store(plugin *p, uint32_t k, double value);
/* Number of the parameter with this id, −1. */
int64_t plugin_named(const plugin *p, const char *id, size_t length);
/* As long as a UTF-8 text fits, in whole characters. */
void plugin_copy_text(char *to, size_t room, const char *from);

/* ---- audio thread ---- */
/* How the block's side begins: silence, nothing told. */
void plugin_begin_anew(plugin *p, int64_t quiet);
/* Gather an event as it is. */
void plugin_put(plugin *p, const jawari_event *event);

/* ---- the drone (plugin_drone.c) ---- */
/* Room for the events of a block of so many, with its own. */
int32_t plugin_drone_room(int32_t events);
/* As when the instance was made, but for what it knows of the host. */
void plugin_drone_begin(plugin *p);
/* The block's events, in order, with those that it plays itself: into `drone.events`; how many there are. */
int32_t plugin_drone_play(plugin *p, const jawari_event *events, int32_t count, int32_t frames);
/* Whether something may come of it by itself. */
bool plugin_drone_waits(const plugin *p);

#endif
