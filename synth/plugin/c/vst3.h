/* vst3.h: the plugin as VST 3, from the inside: one object that is component, processor and controller, in the files vst3_*.c.
 *
 * A host holds a `vst3_face` for each interface it has asked for: the table of its functions, and whose it is.
 */
#ifndef JAWARI_VST3_H
#define JAWARI_VST3_H

#include <stdatomic.h>

#include "plugin.h"
#include "system.h"
#include "vst3_api.h"

typedef struct vst3 vst3;

typedef struct vst3_face {
    const void *table;
    vst3 *owner;
} vst3_face;

enum { COMPONENT, PROCESSOR, REQUIREMENTS, CONTROLLER, MAPPING, UNITS, EXPRESSIONS, FACES };

enum {
    VST3_NOTES = 256,              /* notes whose numbers are known, for what is said of them while they sound */
    VST3_FIRST_MIDI = 0x7FFF0000,  /* id of the first hidden parameter; the others' lie below */
    VST3_MOST_MIDI = 16 * 20
};

typedef struct vst3_note {
    int32_t id;
    int16_t channel, key;
} vst3_note;

/* A MIDI controller that is played as a hidden parameter, for VST 3 has no other way. */
typedef struct vst3_midi {
    uint8_t channel, controller; /* from kAfterTouch on: what is not a controller to MIDI */
} vst3_midi;

struct vst3 {
    vst3_face face[FACES];
    atomic_uint references;
    plugin *plugin;
    uint32_t parameters; /* those of `plugin`; then come the hidden ones */
    uint32_t hidden;
    vst3_midi midi[VST3_MOST_MIDI];
    _Atomic double *shown; /* knob positions as the controller has them */
    double rate;
    int32_t most_frames;
    bool on;          /* between setProcessing(true) and (false) */
    bool ran;         /* since the last reset */
    bool was_silent;  /* after the last block */
    double *nowhere;  /* two blocks for a host that takes no sound */
    vst3_note notes[VST3_NOTES];
    uint32_t noted; /* how many were, ever */
};

extern const IComponent vst3_component;
extern const IAudioProcessor vst3_processor;
extern const IProcessContextRequirements vst3_requirements;
extern const IEditController vst3_controller;
extern const IMidiMapping vst3_mapping;
extern const IUnitInfo vst3_units;
extern const INoteExpressionController vst3_expressions;

/* Functions that every table has. */
tresult vst3_query(void *face, const TUID iid, void **object);
uint32_t vst3_add(void *face);
uint32_t vst3_release(void *face);
tresult vst3_initialize(void *face, void *context);
tresult vst3_terminate(void *face);
#define VST3_COMMON .queryInterface = vst3_query, .addRef = vst3_add, .release = vst3_release

/* The class id by which hosts know a plugin of this uid: as text it is the same on all systems. */
void vst3_class_id(const uint8_t uid[16], TUID id);

/* kResultOk for a rate that the bank has; else the reason is said. */
tresult vst3_check_rate(const vst3 *me);

static inline vst3 *vst3_of(void *face) { return ((vst3_face *)face)->owner; }

/* Why another setup cannot be had is said; in a thread of the plugin's own. */
void vst3_setup_changed(void *of);

/* ---- hidden parameters ---- */

/* Fill in which there are. */
void vst3_list_midi(vst3 *me);
/* Place in `midi` of a parameter id, −1: it is none. */
int64_t vst3_hidden(const vst3 *me, uint32_t id);
/* Position at power-up. */
double vst3_at_rest(vst3_midi what);
/* Play it. */
void vst3_play_midi(vst3 *me, int64_t frame, vst3_midi what, double position);

/* ---- positions ---- */

/* Value at a knob position as hosts have it: steps as VST 3 counts them; a position that went through a float is still that of
 * the initial value. */
double vst3_value(const plugin_parameter *q, double position);
double vst3_position(const plugin_parameter *q, double value);
/* Show what the plugin holds. */
void vst3_show_all(vst3 *me);

/* ---- texts ---- */

/* As much of a text as fits into `room` units, its end included. */
void vst3_wide(int16_t *to, size_t room, const char *utf8);
void vst3_narrow(char *to, size_t room, const int16_t *utf16);

#endif
