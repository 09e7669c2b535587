/* vst3_processor.c: blocks of a VST 3 host: notes, queues of parameters, sound.
 *
 * A queue's points hold from their frame on. VST 3 does not say in which order parameters of one frame come; a controller that
 * chooses a registered parameter goes before the one that sets it, and parameters go before notes.
 */
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "vst3.h"

static tresult set_arrangements(void *face, const uint64_t *in, int32_t ins, const uint64_t *out, int32_t outs) {
    (void)face;
    (void)in;
    return ins == 0 && outs == 1 && out && out[0] == kStereo ? kResultOk : kResultFalse;
}

static tresult get_arrangement(void *face, int32_t direction, int32_t index, uint64_t *arrangement) {
    (void)face;
    if (direction != kOutput || index != 0 || !arrangement) return kInvalidArgument;
    *arrangement = kStereo;
    return kResultOk;
}

static tresult sample_size(void *face, int32_t size) {
    (void)face;
    return size == kSample32 || size == kSample64 ? kResultOk : kResultFalse;
}

static uint32_t latency(void *face) { return (uint32_t)plugin_latency(vst3_of(face)->plugin); }

static uint32_t tail(void *face) {
    const int64_t frames = plugin_tail(vst3_of(face)->plugin);
    return frames < INT32_MAX ? (uint32_t)frames : INT32_MAX;
}

static tresult setup(void *face, const ProcessSetup *given) {
    vst3 *me = vst3_of(face);
    if (!given || given->maxSamplesPerBlock < 0 || plugin_active(me->plugin)) return kInvalidArgument;
    me->rate = given->sampleRate;
    me->most_frames = given->maxSamplesPerBlock;
    return vst3_check_rate(me);
}

/* What sounded before processing was stopped must not be heard when it begins again. */
static tresult set_processing(void *face, TBool on) {
    vst3 *me = vst3_of(face);
    if (!plugin_active(me->plugin)) return kNotInitialized;
    if (on && me->ran) plugin_reset(me->plugin);
    if (on) me->ran = false;
    me->on = on;
    return kResultOk;
}

/* ---- queues ---- */

/* Order of hidden parameters within a frame: those that choose a registered parameter, its coarse value, its fine one, the others. */
enum { RANKS = 4 };
static int32_t rank(uint8_t controller) {
    return controller >= 98 && controller <= 101 ? 0 : controller == 6 ? 1 : controller == 38 ? 2 : 3;
}

/* A visible parameter's points. */
static void change(vst3 *me, const IParamValueQueue **queue, uint32_t k) {
    const plugin_parameter *q = plugin_parameter_of(me->plugin, k);
    for (int32_t j = 0, count = (*queue)->getPointCount(queue); j < count; j++) {
        int32_t frame;
        double x;
        if ((*queue)->getPoint(queue, j, &frame, &x) != kResultOk || !isfinite(x)) continue;
        if (q->fixed) continue;
        plugin_change(me->plugin, frame, k, vst3_value(q, x));
        me->shown[k] = x;
    }
}

/* A hidden parameter's points that are the nth of their frame; whether there are later ones. */
static bool play(vst3 *me, const IParamValueQueue **queue, int64_t hidden, int32_t nth) {
    bool later = false;
    int32_t before = -1, of_frame = 0;
    for (int32_t j = 0, count = (*queue)->getPointCount(queue); j < count; j++) {
        int32_t frame;
        double x;
        if ((*queue)->getPoint(queue, j, &frame, &x) != kResultOk || !(x >= 0.0 && x <= 1.0)) continue;
        of_frame = frame == before ? of_frame + 1 : 0;
        before = frame;
        later |= of_frame > nth;
        if (of_frame != nth) continue;
        vst3_play_midi(me, frame, me->midi[hidden], x);
        me->shown[me->parameters + hidden] = x;
    }
    return later;
}

static void queues(vst3 *me, const IParameterChanges **changes) {
    const int32_t count = (*changes)->getParameterCount(changes);
    bool midi = false;
    for (int32_t k = 0; k < count; k++) {
        const IParamValueQueue **queue = (*changes)->getParameterData(changes, k);
        if (!queue) continue;
        const uint32_t id = (*queue)->getParameterId(queue);
        const int64_t number = plugin_find(me->plugin, id);
        if (number >= 0)
            change(me, queue, (uint32_t)number);
        else
            midi |= vst3_hidden(me, id) >= 0;
    }
    for (int32_t nth = 0; midi; nth++) {
        midi = false;
        for (int32_t of = 0; of < RANKS; of++)
            for (int32_t k = 0; k < count; k++) {
                const IParamValueQueue **queue = (*changes)->getParameterData(changes, k);
                const int64_t hidden = queue ? vst3_hidden(me, (*queue)->getParameterId(queue)) : -1;
                if (hidden >= 0 && rank(me->midi[hidden].controller) == of) midi |= play(me, queue, hidden, nth);
            }
    }
}

/* ---- notes ---- */

static bool is_note(int16_t channel, int16_t key) { return channel >= 0 && channel < 16 && key >= 0 && key < 128; }

static uint8_t seven(double x) { return (uint8_t)lrint(127.0 * (x > 0.0 ? (x < 1.0 ? x : 1.0) : 0.0)); }

static void note_on(vst3 *me, int64_t frame, const NoteOnEvent *note) {
    if (!is_note(note->channel, note->pitch)) return;
    const uint8_t channel = (uint8_t)note->channel, key = (uint8_t)note->pitch;
    if (note->noteId != -1) me->notes[me->noted++ % VST3_NOTES] = (vst3_note){note->noteId, channel, key};
    plugin_note_on(me->plugin, frame, channel, key, note->velocity);
    if (note->tuning != 0.0f && isfinite(note->tuning))
        plugin_note_tuning(me->plugin, frame, channel, key, note->tuning / 100.0);
}

static void express(vst3 *me, int64_t frame, const NoteExpressionValueEvent *said) {
    const uint32_t known = me->noted < VST3_NOTES ? me->noted : VST3_NOTES;
    for (uint32_t back = 1; back <= known; back++) {
        const vst3_note note = me->notes[(me->noted - back) % VST3_NOTES];
        if (note.id != said->noteId) continue;
        if (said->typeId == kTuningTypeID)
            plugin_note_tuning(me->plugin, frame, note.channel, note.key, 240.0 * (said->value - 0.5));
        else if (said->typeId == kBrightnessTypeID)
            plugin_note_brightness(me->plugin, frame, note.channel, note.key, said->value);
        return;
    }
}

static void hear(vst3 *me, const Event *event) {
    const int64_t frame = event->sampleOffset;
    switch (event->type) {
    case kNoteOnEvent: note_on(me, frame, &event->noteOn); break;
    case kNoteOffEvent: {
        const NoteOffEvent *note = &event->noteOff;
        if (!is_note(note->channel, note->pitch)) break;
        const uint8_t bytes[] = {(uint8_t)(0x80 | note->channel), (uint8_t)note->pitch, seven(note->velocity)};
        plugin_midi(me->plugin, frame, bytes, 3);
        break;
    }
    case kPolyPressureEvent: {
        const PolyPressureEvent *note = &event->polyPressure;
        if (is_note(note->channel, note->pitch))
            plugin_note_pressure(me->plugin, frame, note->channel, note->pitch, note->pressure);
        break;
    }
    case kDataEvent:
        if (event->data.type == kMidiSysEx && event->data.bytes) plugin_midi(me->plugin, frame, event->data.bytes, event->data.size);
        break;
    case kNoteExpressionValueEvent:
        if (isfinite(event->noteExpressionValue.value)) express(me, frame, &event->noteExpressionValue);
        break;
    default: break;
    }
}

/* ---- a block ---- */

/* Whether the host takes the sound, in which case one of the pairs is set. */
static bool taken(const ProcessData *data, float **narrow, double **wide) {
    if (data->numOutputs < 1 || !data->outputs || data->outputs[0].numChannels < 2) return false;
    const AudioBusBuffers *out = &data->outputs[0];
    for (int32_t c = 0; c < 2; c++) {
        if (data->symbolicSampleSize == kSample64)
            wide[c] = out->channelBuffers64 ? out->channelBuffers64[c] : NULL;
        else
            narrow[c] = out->channelBuffers32 ? out->channelBuffers32[c] : NULL;
    }
    return data->symbolicSampleSize == kSample64 ? wide[0] && wide[1] : narrow[0] && narrow[1];
}

static void transport(vst3 *me, const ProcessContext *context) {
    const uint32_t state = context ? context->state : 0;
    plugin_transport(me->plugin, 0, state & kPlaying, state & kProjectTimeMusicValid ? context->projectTimeMusic : (double)NAN,
                     state & kTempoValid ? context->tempo : (double)NAN);
}

static tresult process(void *face, ProcessData *data) {
    vst3 *me = vst3_of(face);
    if (!data || data->numSamples < 0) return kInvalidArgument;
    if (!plugin_active(me->plugin)) return kNotInitialized;
    float *narrow[2] = {NULL, NULL};
    double *wide[2] = {NULL, NULL};
    const bool given = taken(data, narrow, wide);
    if (!given && data->numSamples > me->most_frames) return kInvalidArgument;
    if (!given) wide[0] = me->nowhere, wide[1] = me->nowhere + me->most_frames;
    const bool is_wide = !given || data->symbolicSampleSize == kSample64;
    bool quiet = me->was_silent;
    transport(me, data->processContext);
    if (data->inputParameterChanges) {
        quiet &= (*data->inputParameterChanges)->getParameterCount(data->inputParameterChanges) == 0;
        queues(me, data->inputParameterChanges);
    }
    if (data->inputEvents) {
        const int32_t count = (*data->inputEvents)->getEventCount(data->inputEvents);
        quiet &= count == 0;
        for (int32_t k = 0; k < count; k++) {
            Event event;
            if ((*data->inputEvents)->getEvent(data->inputEvents, k, &event) == kResultOk) hear(me, &event);
        }
    }
    plugin_process(me->plugin, data->numSamples, is_wide ? NULL : narrow, is_wide ? wide : NULL);
    if (data->numSamples > 0) me->ran = true;
    me->was_silent = plugin_silent(me->plugin);
    if (given) data->outputs[0].silenceFlags = quiet && me->was_silent ? 3 : 0;
    return kResultOk;
}

const IAudioProcessor vst3_processor = {
    VST3_COMMON,
    .setBusArrangements = set_arrangements,
    .getBusArrangement = get_arrangement,
    .canProcessSampleSize = sample_size,
    .getLatencySamples = latency,
    .setupProcessing = setup,
    .setProcessing = set_processing,
    .process = process,
    .getTailSamples = tail,
};

/* ---- what is needed of the transport: a drone follows it ---- */

static uint32_t needed(void *face) {
    (void)face;
    return kNeedProjectTimeMusic | kNeedTempo | kNeedTransportState;
}

const IProcessContextRequirements vst3_requirements = {VST3_COMMON, .getProcessContextRequirements = needed};
