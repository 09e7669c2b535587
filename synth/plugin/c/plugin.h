/* plugin.h: what CLAP, VST3 and LV2 have in common: an engine behind a host's rules. Private to the plugin.
 *
 * An instance knows the values of all parameters whether it is active or not, gathers the events of a block, and keeps a state
 * that later versions read. Parameters are numbered 0 … plugin_parameters() − 1: those of the presets (jawari_parameter), those of
 * their setup (jawari_setup_number_of), which are changed where Python is there and are no events, then the plugin's own: "program"
 * (which preset channel 1 to 16 plays; only where there are several), those of the drone, where the bank has one, and, the last,
 * "bypass".
 */
#ifndef JAWARI_PLUGIN_H
#define JAWARI_PLUGIN_H

#include <stdbool.h>

#include "jawari.h"

typedef struct plugin plugin;

typedef struct plugin_parameter {
    uint32_t stable_id; /* below 0x7FFF0000; follows from preset id and parameter id alone: hosts keep automation by it */
    char id[160];       /* "tanpura/pluck.position" */
    char name[96];      /* "Pluck position from the saddle" */
    char group[128];    /* preset's name; empty: the plugin's own */
    char unit[16];
    double minimum, maximum, initial;
    int32_t curve;      /* JAWARI_LINEAR, … */
    int32_t part;       /* number of the preset; −1: the plugin's own */
    bool stepped;       /* whole numbers */
    bool bypass;
    bool program;
    const char *texts[3]; /* of the values 0, 1, …; NULL: its values are numbers */
    bool setup;         /* a number of the setup: heard some seconds later, not to be automated */
    bool fixed;         /* it can only be shown */
} plugin_parameter;

/* ---- any thread but audio ---- */

/* An instance on the bank behind this very file. NULL with `why`. */
plugin *plugin_new(char *why);
void plugin_free(plugin *p);

const jawari_bank *plugin_bank(const plugin *p);
uint32_t plugin_parameters(const plugin *p);
const plugin_parameter *plugin_parameter_of(const plugin *p, uint32_t k); /* NULL beyond */
int64_t plugin_find(const plugin *p, uint32_t stable_id);                 /* its number, −1 */

/* Sound can be asked for from now on, at this rate; false with `why` (a rate that the bank does not have, …). */
bool plugin_activate(plugin *p, double rate_hz, int32_t threads, bool host_threads, char *why);
void plugin_deactivate(plugin *p);
bool plugin_active(const plugin *p);
/* [Frames], of the first rate before it was ever active. [any] while active */
int32_t plugin_latency(const plugin *p);
/* Frames from the last event until it has rung out: the latency is part of it. [any] while active */
int64_t plugin_tail(const plugin *p);
int32_t plugin_threads(const plugin *p); /* how many compute; 1 while not active. [any] */
/* How many threads the variable JAWARI_THREADS asks for, 1 to 16; 0: it says nothing. */
int32_t plugin_wanted_threads(void);

/* The value that was set last. [any] */
double plugin_value(const plugin *p, uint32_t k);
/* The value that is played: of the setup another one, as long as its bank is not there. [any] */
double plugin_played(const plugin *p, uint32_t k);
/* Called, in a thread of the plugin's own, when texts of the setup have become others. To be set before it is first active. */
void plugin_when_changed(plugin *p, void (*call)(void *), void *whose);
/* What there is to be said of the setup, once: a sentence; false: nothing. */
bool plugin_remark(plugin *p, char *why);
/* A value as a host shows it ("12.5 mm", "tanpura", "on"), and back; false for what is no value. [any but audio] */
bool plugin_text(const plugin *p, uint32_t k, double value, char *text, size_t room);
bool plugin_number(const plugin *p, uint32_t k, const char *text, double *value);
/* A number of six significant digits, and the one at the start of a text (where it ends; NULL: there is none), with a point in
 * every locale. [any] */
void plugin_write_number(char *text, size_t room, double value);
const char *plugin_read_number(const char *text, double *value);
/* Knob position 0 … 1 for a value, by the parameter's curve, and back; both keep the range. [any] */
double plugin_position(const plugin_parameter *q, double value);
double plugin_at(const plugin_parameter *q, double position);
/* Set outside of a block (a flush, a generic editor): heard from the start of the next block on. [any] */
void plugin_set(plugin *p, uint32_t k, double value);

/* The state: values of all parameters by id. Allocated with malloc, to be freed by the caller; NULL: no memory. May be called
 * beside [audio]. */
void *plugin_save(const plugin *p, size_t *size);
/* Taken over at the start of the next block, as by plugin_reset: what sounds fades within 3 ms. Values that this plugin does not
 * have are passed over, those that the state does not have get their initial value, and so does the program where another plugin
 * saved it, which numbers other presets. False, with `why` and nothing changed, for what is no state, and for that of another
 * plugin which has no value for any preset of this one. May be called beside [audio]. */
bool plugin_load(plugin *p, const void *data, size_t size, char *why);

/* ---- audio thread ---- */

/* Events of the block that is to come; order by frame is kept by the plugin for events that come unordered. */
void plugin_midi(plugin *p, int64_t frame, const uint8_t *bytes, size_t size);
void plugin_event(plugin *p, const jawari_event *event);
void plugin_change(plugin *p, int64_t frame, uint32_t k, double value); /* a parameter, sample-accurate */

/* What the host says of its transport, from this frame on: place in quarter notes, tempo in those a minute; NaN: not known. */
void plugin_transport(plugin *p, int64_t frame, bool playing, double beat, double tempo);

/* A note by its velocity 0 … 1, which becomes 1 … 127. */
void plugin_note_on(plugin *p, int64_t frame, int32_t channel, int32_t key, double velocity);
/* What a host says of one note while it sounds: semitones off the key's pitch, taken back before the key's next note; pressure
 * 0 … 1 on the key; brightness 0 … 1, which is controller 74 of its channel. */
void plugin_note_tuning(plugin *p, int64_t frame, int32_t channel, int32_t key, double semitones);
void plugin_note_pressure(plugin *p, int64_t frame, int32_t channel, int32_t key, double pressure);
void plugin_note_brightness(plugin *p, int64_t frame, int32_t channel, int32_t key, double brightness);

/* The block, and the gathered events are gone. Exactly one pair is not NULL, and no frames at all are fine. Bypassed: silence, notes still end. */
void plugin_process(plugin *p, int32_t frames, float *const left_right[2], double *const left_right_wide[2]);
/* As jawari_reset; parameters keep their values. */
void plugin_reset(plugin *p);
/* Strings that sound now. */
int32_t plugin_voices(const plugin *p);
/* Whether a string sounds for this note of this channel. */
bool plugin_sounding(const plugin *p, int32_t channel, int32_t key);
/* Whether nothing sounds, on its way out included, and nothing waits: hosts may let it sleep. */
bool plugin_silent(const plugin *p);
/* Lent threads, see jawari_help. */
void plugin_help(plugin *p, int32_t k);

#endif
