/* jawari.h: strings that collide, without Python.
 *
 *     char why[JAWARI_WHY];
 *     jawari_bank *bank = jawari_open("tanpura.jawari", why);
 *     jawari_engine *engine = jawari_create(bank, 48000.0, 1, why);
 *     jawari_event events[] = {{0, JAWARI_NOTE_ON, 0, 48, 100, 0.0}};
 *     jawari_process(engine, events, 1, 256, left, right);
 *     jawari_destroy(engine);
 *     jawari_close(bank);
 *
 * A bank holds one or several presets, compiled for one or several sample rates; it is read only, and shared by the engines
 * made of it. Each preset is a part; MIDI programs choose among them. What a function cannot do it says in a sentence, in
 * `why` (room for JAWARI_WHY bytes, or NULL), and gives NULL or a number below zero.
 *
 * Threads: what is marked [audio] takes no lock, allocates nothing and opens no file; for one engine it must not be called by
 * two threads at once. All else may take its time. Functions marked [any] may be called beside [audio]. Different engines
 * know nothing of each other.
 */
#ifndef JAWARI_H
#define JAWARI_H

#include <stddef.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#if defined(_WIN32)
#define JAWARI_API __declspec(dllexport)
#elif defined(__GNUC__)
#define JAWARI_API __attribute__((visibility("default")))
#else
#define JAWARI_API
#endif

/* ---- library and bank ---------------------------------------------------------------------------------------------- */

enum { JAWARI_WHY = 512, JAWARI_BORDER = 64 /* of a bank in memory [bytes] */ };

typedef struct jawari_bank jawari_bank;
typedef struct jawari_engine jawari_engine;

/* The version of the program that this library comes from, like "0.8.0". [any] */
JAWARI_API const char *jawari_version(void);

/* The instructions that it uses on this processor ("x86-64-v4", "x86-64-v3", "aarch64", "portable"); NULL: there are none. [any] */
JAWARI_API const char *jawari_processor(char *why);

/* The bank in a file: a file of its own, or one that stands behind the end of a library or plugin.
 *
 * A bank is to be trusted like code. Its checksums find damage, not forgery: a bank that somebody has made with right checksums
 * can end the program. Open banks only from where your own program keeps them. */
JAWARI_API jawari_bank *jawari_open(const char *path, char *why);

/* The bank in bytes that the caller keeps as they are, on a border of 64, until it is closed. */
JAWARI_API jawari_bank *jawari_open_bytes(const void *data, size_t size, char *why);

/* The bank that stands behind the end of the file from which this library was loaded, even where another file has that name by
 * now: it is kept open from then on. Where a signature forbids that (macOS), it is the file bank.jawari among the resources of
 * the library's bundle, or beside the library where it has none. Opened twice it is there once. */
JAWARI_API jawari_bank *jawari_open_own(char *why);

/* A packed bank: a bank without what follows from the rest of it, as web pages load it. How many bytes it has unpacked; −1: these
 * bytes are none. */
JAWARI_API int64_t jawari_unpacked_size(const void *packed, size_t size);

/* The bank, into exactly so many bytes on a border of eight (of 64, to be played from there): 0, or −1 and what is there is of no
 * use, where the packed bank was changed or cut off. */
JAWARI_API int jawari_unpack(const void *packed, size_t size, void *out, size_t room, char *why);

/* Another hold on an open bank, to be closed as well. */
JAWARI_API jawari_bank *jawari_hold(jawari_bank *bank);

/* Let it go; it stays until the last engine made of it has gone. NULL is nothing. */
JAWARI_API void jawari_close(jawari_bank *bank);

typedef struct jawari_preset {
    const char *id;          /* "tanpura" */
    const char *name;        /* for people */
    const char *description; /* a line */
    int32_t lowest_note, highest_note;
} jawari_preset;

/* How many presets there are. */
JAWARI_API int32_t jawari_presets(const jawari_bank *bank);
/* The k-th; its texts stay as long as the bank. NULL beyond. */
JAWARI_API const jawari_preset *jawari_preset_of(const jawari_bank *bank, int32_t k);

/* The bank's own id and name: of a single preset that preset's. */
JAWARI_API const char *jawari_bank_id(const jawari_bank *bank);
JAWARI_API const char *jawari_bank_name(const jawari_bank *bank);
/* 16 bytes by which hosts know a plugin with this bank, the same in every version. */
JAWARI_API const uint8_t *jawari_bank_uid(const jawari_bank *bank);

/* Strings of all presets: as many notes can sound at once. */
JAWARI_API int32_t jawari_strings(const jawari_bank *bank);

/* How many sample rates there are; the k-th [Hz], ascending, 0 beyond. */
JAWARI_API int32_t jawari_rates(const jawari_bank *bank);
JAWARI_API double jawari_rate_of(const jawari_bank *bank, int32_t k);

/* How a knob best runs through a parameter's range. */
enum { JAWARI_LINEAR, JAWARI_RATIO, JAWARI_SQUARE };

typedef struct jawari_parameter {
    int32_t part;   /* number of the preset */
    int32_t index;  /* `a` of a JAWARI_PARAMETER event */
    int32_t curve;  /* JAWARI_LINEAR … */
    const char *id; /* "pluck.position" */
    const char *name, *unit;
    double minimum, maximum, initial;
    double smoothing_s; /* over which a change is spread; 0: it holds for the next pluck */
} jawari_parameter;

/* Live parameters of all presets, those of the first preset first; the k-th, NULL beyond. */
JAWARI_API int32_t jawari_parameters(const jawari_bank *bank);
JAWARI_API const jawari_parameter *jawari_parameter_of(const jawari_bank *bank, int32_t k);

/* Numbers of the presets' setup, which were compiled in: lengths, threads, action. They are shown and not set; a bank that has
 * others is made by Python. `index`: among those of its preset; `initial`: the value. The k-th, NULL beyond. */
JAWARI_API int32_t jawari_setup_numbers(const jawari_bank *bank);
JAWARI_API const jawari_parameter *jawari_setup_number_of(const jawari_bank *bank, int32_t k);

/* What tells a bank's contents from others'. */
JAWARI_API uint32_t jawari_bank_checksum(const jawari_bank *bank);

/* ---- engine -------------------------------------------------------------------------------------------------------- */

/* An engine for one of the bank's rates, silent. threads: how many compute, the caller of jawari_process included, at most as
 * many as there are strings and as the calling thread may use processors; they change no sample. Refused: a rate that the bank does not have (`why` lists those that it has), no memory. */
JAWARI_API jawari_engine *jawari_create(jawari_bank *bank, double rate_hz, int32_t threads, char *why);

/* NULL is nothing. */
JAWARI_API void jawari_destroy(jawari_engine *engine);

/* Kinds of events, and what their fields hold. */
enum {
    JAWARI_NOTE_ON = 1,      /* a note, b velocity 1 … 127 */
    JAWARI_NOTE_OFF = 2,     /* a note, b release velocity */
    JAWARI_CONTROL = 3,      /* a controller, b value */
    JAWARI_BEND = 4,         /* a −8192 … 8191 */
    JAWARI_PROGRAM = 5,      /* a program: from now on the channel plays this preset */
    JAWARI_PARAMETER = 6,    /* channel: the part; a: jawari_parameter.index; value */
    JAWARI_PRESSURE = 7,     /* b of the channel */
    JAWARI_KEY_PRESSURE = 8, /* a note, b pressure */
    JAWARI_TUNING = 9        /* a key, value its pitch in semitones (69.0: 440 Hz; NaN: as compiled), b 1: at once, 0: with the
                                next pluck; for all channels */
};

typedef struct jawari_event {
    int64_t frame; /* from the start of the block */
    int32_t kind, channel, a, b;
    double value;
} jawari_event;

/* A MIDI message of one to three bytes, or a system exclusive one with its F0 and F7, as events at a frame: their number, at
 * most `room` are written. Tunings (MTS) and this program's own messages are read; 0 for what is not to be played. [audio] */
JAWARI_API int32_t jawari_midi(const uint8_t *bytes, size_t size, int64_t frame, jawari_event *events, int32_t room);

/* One block: `count` events in order of their frames, 0 ≤ frame < frames (others are moved to the nearer end), and what
 * sounds, overwritten. What is no event is left out. More events in a block than the queue holds are counted as dropped.
 * Any number of frames from 0 on, from block to block another: the sound does not depend on it. [audio] */
JAWARI_API void jawari_process(jawari_engine *engine, const jawari_event *events, int32_t count, int32_t frames, double *left,
                               double *right);

/* The same, rounded to float. [audio] */
JAWARI_API void jawari_process_float(jawari_engine *engine, const jawari_event *events, int32_t count, int32_t frames,
                                     float *left, float *right);

/* Silence, controllers and parameters as when it was made. What sounded fades within 3 ms of the next block. [audio] */
JAWARI_API void jawari_reset(jawari_engine *engine);

JAWARI_API double jawari_rate(const jawari_engine *engine);
/* How many threads compute. [any] */
JAWARI_API int32_t jawari_threads(const jawari_engine *engine);
/* Frames from an event to the moment the string feels it. [any] */
JAWARI_API int32_t jawari_latency(const jawari_engine *engine);
/* Frames to −60 dB of the string that rings longest. [any] */
JAWARI_API int64_t jawari_tail(const jawari_engine *engine);
/* Strings that sound now; whether nothing sounds and no event waits. [audio] */
JAWARI_API int32_t jawari_voices(const jawari_engine *engine);
JAWARI_API int32_t jawari_silent(const jawari_engine *engine);
/* Value of a live parameter now: as last set, the range kept. [audio] */
JAWARI_API double jawari_value(const jawari_engine *engine, int32_t part, int32_t index);
/* The program that a channel 0 … 15 plays now. [audio] */
JAWARI_API int32_t jawari_program(const jawari_engine *engine, int32_t channel);
/* Pitch of a key 0 … 127 as compiled [semitones]. [audio] */
JAWARI_API double jawari_pitch(const jawari_engine *engine, int32_t key);
/* Whether a string sounds for this note of this channel. [audio] */
JAWARI_API int32_t jawari_sounding(const jawari_engine *engine, int32_t channel, int32_t note);

/* Let an engine that is silent go on with what was set in another, of another bank of the same presets: channels, parameters,
 * tunings; nothing that sounds. [audio] of both */
JAWARI_API void jawari_follow(jawari_engine *engine, const jawari_engine *from);
/* Whether an event is on its way to the strings. [audio] */
JAWARI_API int32_t jawari_waiting(const jawari_engine *engine);

typedef struct jawari_report {
    double peak;               /* since the reset, 1: full scale */
    int64_t notes;             /* plucked */
    int64_t unplayed;          /* notes that found no string */
    int64_t stolen;            /* strings taken from other notes */
    int64_t dropped;           /* events that found the queue full */
    int64_t silenced;          /* strings whose motion had blown up */
} jawari_report;
JAWARI_API void jawari_report_of(const jawari_engine *engine, jawari_report *report); /* [audio] */

/* ---- threads of the host ------------------------------------------------------------------------------------------- */

/* A host that has threads of its own may lend them: it calls jawari_help(engine, k), 1 ≤ k < jawari_threads(engine), from
 * as many threads as it likes while one is in jawari_process [audio]; each returns when that block is done, has not begun, or
 * another thread helps as k. An engine that is helped has no threads of its own: jawari_lend says so before its first block, and
 * ends those that there are. */
JAWARI_API void jawari_lend(jawari_engine *engine);
JAWARI_API void jawari_help(jawari_engine *engine, int32_t k);

/* ---- kernels ------------------------------------------------------------------------------------------------------- */

/* Address of a compiled function by its name in the sources ("engine.process:process"), for the Python program; NULL: it is not
 * in here. What it takes is private to the version. [any] */
JAWARI_API void *jawari_kernel(const char *name);
/* What tells the sources of the kernels in here from others'. [any] */
JAWARI_API const char *jawari_kernels_version(void);

#ifdef __cplusplus
}
#endif
#endif
