/* plugin_private.h: an instance from the inside, for the files plugin*.c.
 *
 * Who may touch what: `values` is atomic and belongs to all. What stands under "audio thread" is changed only between
 * plugin_begin and plugin_end, while `turn` is odd: who copies it beside the audio thread looks at `turn` before and
 * after, and copies again where it has changed. All else is guarded by `guard`, which the audio thread never takes.
 */
#ifndef JAWARI_PLUGIN_PRIVATE_H
#define JAWARI_PLUGIN_PRIVATE_H

#include <pthread.h>
#include <stdatomic.h>

#include "plugin.h"

enum {
    PLUGIN_EVENTS = 8192,  /* gathered in one block at most */
    PLUGIN_CHANNELS = 16,
    PLUGIN_KEYS = 128,
    PLUGIN_LETTING_GO = 2 * PLUGIN_CHANNELS, /* events that let all notes go */
    PLUGIN_NOTHING = 0,    /* kind of an event that was taken out */
    PLUGIN_BYPASS = 1000   /* kind of an event that the engine does not know: `a` 1: bypassed from this frame on */
};

/* The pitches of the keys as the instance has set them: by tunings, and by what is said of single notes. */
typedef struct plugin_pitches {
    double tuned[PLUGIN_KEYS]; /* as a TUNING event has it; NaN: as compiled */
    uint8_t bent[PLUGIN_KEYS]; /* 1: a note is off this pitch, to be taken back before the next one */
} plugin_pitches;

/* What sounds, in bytes of the engine, and what goes with it. */
typedef struct plugin_sound {
    double *sent; /* as in `plugin` */
    plugin_pitches pitches;
    uint8_t *bytes;
    size_t room;
    int64_t size; /* −1: it could not be had */
} plugin_sound;

/* A state on its way to the audio thread, and back to be freed. */
typedef struct plugin_message {
    struct plugin_message *next;
    plugin_sound sound;
} plugin_message;

/* A copy of what sounds that the audio thread is asked for. */
typedef struct plugin_request {
    plugin_sound *sound;
    atomic_int done;
} plugin_request;

typedef struct plugin_target {
    int32_t part, index; /* of a preset's parameter */
} plugin_target;

struct plugin {
    jawari_bank *bank;
    uint32_t count;
    uint32_t of_presets; /* parameters that are a preset's; the others are the plugin's own */
    int64_t program, bypass; /* numbers of these two; −1: there is none */
    plugin_parameter *parameters;
    plugin_target *targets;
    _Atomic uint64_t *values; /* bits of a double */

    pthread_mutex_t guard;
    jawari_engine *engine; /* changed only while no audio thread runs */
    int32_t threads;
    int32_t latency; /* −1: not known yet */
    int64_t tail;

    _Atomic(plugin_message *) incoming; /* to be taken over by the audio thread */
    _Atomic(plugin_message *) spent;    /* taken over: a list to be freed by others */
    _Atomic(plugin_request *) request;
    atomic_uint turn;

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
    int64_t quiet;          /* frames since anything was heard */
};

/* A parameter's value, brought into its range. */
double plugin_kept(const plugin_parameter *q, double value);
void plugin_store(plugin *p, uint32_t k, double value);
/* Number of the parameter with this id, −1. */
int64_t plugin_named(const plugin *p, const char *id, size_t length);
/* Free what the audio thread is done with. Guarded. */
void plugin_sweep(plugin *p);
void plugin_message_free(plugin_message *m);
/* As long as a UTF-8 text fits, in whole characters. */
void plugin_copy_text(char *to, size_t room, const char *from);

/* ---- audio thread ---- */
/* All that sounds as of now. */
void plugin_copy_sound(const plugin *p, plugin_sound *sound);
/* How the block's side begins: silence, nothing told. */
void plugin_begin_anew(plugin *p, int64_t quiet);

#endif
