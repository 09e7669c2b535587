/* vst3_midi.c: the MIDI controllers that are hidden parameters, for VST 3 hosts hand controllers over in no other way.
 *
 * Each one costs hosts time when they load the plugin (Pedalboard 3.5 ms), and some list them all: so there are only those that the
 * engine reads; of channel 1 all, which is where most keyboards play and where a zone of MPE is set up, of the others what is
 * played with and what registered parameters need, for MPE hosts set the bend range of each channel, and the upper zone by
 * channel 16. Not cents of that range (38), what chooses other parameters than registered ones (98, 99) and the channel modes
 * (120, 121, 123): a zone hears those of its master, and VST 3 hosts end notes by themselves.
 */
#include <math.h>

#include "vst3.h"

static const uint8_t of_first_channel[] = {6, 7, 10, 11, 38, 64, 68, 74, 98, 99, 100, 101, 120, 121, 123, kAfterTouch, kPitchBend};
static const uint8_t of_every_channel[] = {7, 10, 11, 64, 74, kAfterTouch, kPitchBend};
static const uint8_t of_other_channels[] = {6, 100, 101};

void vst3_list_midi(vst3 *me) {
    const bool several = jawari_presets(plugin_bank(me->plugin)) > 1;
    me->hidden = 0;
    for (uint8_t channel = 0; channel < 16; channel++) {
        const uint8_t *these = channel ? of_every_channel : of_first_channel;
        const size_t many = channel ? sizeof of_every_channel : sizeof of_first_channel;
        for (size_t k = 0; k < many; k++) me->midi[me->hidden++] = (vst3_midi){channel, these[k]};
        if (several) me->midi[me->hidden++] = (vst3_midi){channel, kCtrlProgramChange};
    }
    /* behind all others: hosts know parameters by their places here */
    for (uint8_t channel = 1; channel < 16; channel++)
        for (size_t k = 0; k < sizeof of_other_channels; k++) me->midi[me->hidden++] = (vst3_midi){channel, of_other_channels[k]};
}

int64_t vst3_hidden(const vst3 *me, uint32_t id) {
    return id >= VST3_FIRST_MIDI && id - VST3_FIRST_MIDI < me->hidden ? (int64_t)(id - VST3_FIRST_MIDI) : -1;
}

double vst3_at_rest(vst3_midi what) {
    switch (what.controller) {
    case 7: return 100.0 / 127.0;
    case 10:
    case 74: return 64.0 / 127.0;
    case kPitchBend: return 8192.0 / 16383.0;
    case 11:
    case 98:
    case 99:
    case 100:
    case 101: return 1.0;
    default: return 0.0;
    }
}

void vst3_play_midi(vst3 *me, int64_t frame, vst3_midi what, double position) {
    const uint8_t channel = what.channel;
    const int32_t seven = (int32_t)lrint(127.0 * position), fourteen = (int32_t)lrint(16383.0 * position);
    if (what.controller == kPitchBend)
        plugin_midi(me->plugin, frame, (const uint8_t[]){0xE0 | channel, (uint8_t)(fourteen & 127), (uint8_t)(fourteen >> 7)}, 3);
    else if (what.controller == kAfterTouch)
        plugin_midi(me->plugin, frame, (const uint8_t[]){0xD0 | channel, (uint8_t)seven}, 2);
    else if (what.controller == kCtrlProgramChange)
        plugin_midi(me->plugin, frame, (const uint8_t[]){0xC0 | channel, (uint8_t)seven}, 2);
    else
        plugin_midi(me->plugin, frame, (const uint8_t[]){0xB0 | channel, what.controller, (uint8_t)seven}, 3);
}
