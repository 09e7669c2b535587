/* vst3_controller.c: what a VST 3 host shows of the parameters: their names, texts and knob positions, units, programs.
 *
 * The positions here are those of the controller; the processor hears of a change by the queues of a block. Only while no sound is
 * asked for does a change go straight to the values.
 */
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "vst3.h"

enum { PROGRAM_LIST = 1 };

static double within(double x) { return x > 0.0 ? (x < 1.0 ? x : 1.0) : 0.0; } /* of no number: 0 */

static double steps_of(const plugin_parameter *q) { return q->maximum - q->minimum; }

double vst3_value(const plugin_parameter *q, double position) {
    const double x = within(position);
    if (q->stepped) return q->minimum + fmin(steps_of(q), floor(x * (steps_of(q) + 1.0)));
    return (float)x == (float)plugin_position(q, q->initial) ? q->initial : plugin_at(q, x);
}

double vst3_position(const plugin_parameter *q, double value) {
    if (!q->stepped) return plugin_position(q, value);
    return steps_of(q) > 0.0 ? within((value - q->minimum) / steps_of(q)) : 0.0;
}

void vst3_show_all(vst3 *me) {
    for (uint32_t k = 0; k < me->parameters; k++)
        me->shown[k] = vst3_position(plugin_parameter_of(me->plugin, k), plugin_value(me->plugin, k));
}

/* Place in `shown` of a parameter id, −1. */
static int64_t place(const vst3 *me, uint32_t id) {
    const int64_t hidden = vst3_hidden(me, id);
    return hidden < 0 ? plugin_find(me->plugin, id) : me->parameters + hidden;
}

/* The plugin's own parameter of an id; NULL: it is a hidden one, or none. */
static const plugin_parameter *visible(const vst3 *me, uint32_t id) {
    const int64_t k = plugin_find(me->plugin, id);
    return k < 0 ? NULL : plugin_parameter_of(me->plugin, (uint32_t)k);
}

/* ---- controller ---- */

/* The component is this very object and has it already. */
static tresult set_component_state(void *face, const IBStream **stream) {
    (void)face;
    return stream ? kResultOk : kInvalidArgument;
}

/* There is nothing that only a controller knows. */
static tresult own_state(void *face, const IBStream **stream) {
    (void)face;
    return stream ? kResultOk : kInvalidArgument;
}

static int32_t parameter_count(void *face) { return (int32_t)(vst3_of(face)->parameters + vst3_of(face)->hidden); }

static int32_t presets(const vst3 *me) { return jawari_presets(plugin_bank(me->plugin)); }

/* The unit of a preset's parameters; presets alone in their plugin have none of their own. */
static int32_t unit_of(const vst3 *me, uint32_t k) {
    const plugin_parameter *q = plugin_parameter_of(me->plugin, k);
    return q->part >= 0 && presets(me) > 1 ? q->part + 1 : kRootUnitId;
}

static tresult parameter_info(void *face, int32_t index, ParameterInfo *info) {
    vst3 *me = vst3_of(face);
    if (index < 0 || index >= parameter_count(face) || !info) return kInvalidArgument;
    const uint32_t k = (uint32_t)index;
    memset(info, 0, sizeof *info);
    if (k >= me->parameters) {
        const vst3_midi what = me->midi[k - me->parameters];
        char name[48];
        const char *of = what.controller == kAfterTouch ? "pressure" : what.controller == kPitchBend ? "bend" : "program";
        if (what.controller < kAfterTouch)
            snprintf(name, sizeof name, "MIDI %d controller %d", what.channel + 1, what.controller);
        else
            snprintf(name, sizeof name, "MIDI %d %s", what.channel + 1, of);
        info->id = VST3_FIRST_MIDI + (k - me->parameters);
        vst3_wide(info->title, 128, name);
        vst3_wide(info->shortTitle, 128, name);
        info->defaultNormalizedValue = vst3_at_rest(what);
        info->flags = kIsHidden;
        return kResultOk;
    }
    const plugin_parameter *q = plugin_parameter_of(me->plugin, k);
    info->id = q->stable_id;
    const int32_t unit = unit_of(me, k);
    char title[256]; /* many hosts show no units of VST 3, but one list of parameters */
    snprintf(title, sizeof title, "%s%s%s", unit ? q->group : "", unit ? ": " : "", q->name);
    vst3_wide(info->title, 128, title);
    vst3_wide(info->shortTitle, 128, q->name);
    vst3_wide(info->units, 128, q->setup ? "" : q->unit); /* its text says more, and the unit in the midst of it */
    info->stepCount = q->stepped ? (int32_t)steps_of(q) : 0;
    info->defaultNormalizedValue = vst3_position(q, q->initial);
    info->unitId = unit;
    info->flags = q->fixed ? kIsReadOnly : q->setup ? 0 : kCanAutomate;
    if (q->bypass)
        info->flags |= kIsBypass;
    else if (q->program)
        info->flags |= kIsList | kIsProgramChange;
    else if (q->texts[0])
        info->flags |= kIsList;
    return kResultOk;
}

/* Hosts put the unit behind the text themselves. */
static void without_unit(char *text, const char *unit) {
    const size_t n = strlen(text), m = strlen(unit);
    if (m && n > m + 1 && text[n - m - 1] == ' ' && !strcmp(text + n - m, unit)) text[n - m - 1] = 0;
}

static tresult text_of_value(void *face, uint32_t id, double position, String128 text) {
    vst3 *me = vst3_of(face);
    const int64_t k = place(me, id);
    char narrow[128] = "";
    if (k < 0 || !text) return kInvalidArgument;
    const plugin_parameter *q = visible(me, id);
    if (!q)
        snprintf(narrow, sizeof narrow, "%.0f", 127.0 * within(position));
    else if (plugin_text(me->plugin, (uint32_t)k, vst3_value(q, position), narrow, sizeof narrow))
        without_unit(narrow, q->setup ? "" : q->unit);
    else
        return kResultFalse;
    vst3_wide(text, 128, narrow);
    return kResultOk;
}

static tresult value_of_text(void *face, uint32_t id, const int16_t *text, double *position) {
    vst3 *me = vst3_of(face);
    const int64_t k = plugin_find(me->plugin, id);
    if (k < 0 || !text || !position) return kInvalidArgument;
    char narrow[256];
    double value;
    vst3_narrow(narrow, sizeof narrow, text);
    if (!plugin_number(me->plugin, (uint32_t)k, narrow, &value)) return kResultFalse;
    *position = vst3_position(visible(me, id), value);
    return kResultOk;
}

static double plain(void *face, uint32_t id, double position) {
    const plugin_parameter *q = visible(vst3_of(face), id);
    return q ? vst3_value(q, position) : position;
}

static double normalized(void *face, uint32_t id, double value) {
    const plugin_parameter *q = visible(vst3_of(face), id);
    return q ? vst3_position(q, value) : value;
}

static double get_position(void *face, uint32_t id) {
    vst3 *me = vst3_of(face);
    const int64_t k = place(me, id);
    return k < 0 ? 0.0 : me->shown[k];
}

static tresult set_position(void *face, uint32_t id, double position) {
    vst3 *me = vst3_of(face);
    const int64_t k = place(me, id);
    if (k < 0 || !isfinite(position)) return kInvalidArgument;
    const plugin_parameter *q = visible(me, id);
    if (q && q->fixed) return kResultFalse;
    me->shown[k] = within(position);
    if (q && (!me->on || q->setup)) plugin_set(me->plugin, (uint32_t)k, vst3_value(q, position));
    return kResultOk;
}

static tresult set_handler(void *face, void *handler) {
    (void)face;
    (void)handler;
    return kResultOk;
}

static void *no_view(void *face, const char *name) {
    (void)face;
    (void)name;
    return NULL;
}

const IEditController vst3_controller = {
    VST3_COMMON,
    .initialize = vst3_initialize,
    .terminate = vst3_terminate,
    .setComponentState = set_component_state,
    .setState = own_state,
    .getState = own_state,
    .getParameterCount = parameter_count,
    .getParameterInfo = parameter_info,
    .getParamStringByValue = text_of_value,
    .getParamValueByString = value_of_text,
    .normalizedParamToPlain = plain,
    .plainParamToNormalized = normalized,
    .getParamNormalized = get_position,
    .setParamNormalized = set_position,
    .setComponentHandler = set_handler,
    .createView = no_view,
};

/* ---- MIDI ---- */

static tresult assignment(void *face, int32_t bus, int16_t channel, int16_t controller, uint32_t *id) {
    vst3 *me = vst3_of(face);
    if (bus != 0 || !id) return kInvalidArgument;
    for (uint32_t k = 0; k < me->hidden; k++)
        if (me->midi[k].channel == channel && me->midi[k].controller == controller) {
            *id = VST3_FIRST_MIDI + k;
            return kResultOk;
        }
    return kResultFalse;
}

const IMidiMapping vst3_mapping = {VST3_COMMON, .getMidiControllerAssignment = assignment};

/* ---- units and programs: the presets ---- */

static int32_t unit_count(void *face) { return presets(vst3_of(face)) > 1 ? presets(vst3_of(face)) + 1 : 1; }

static tresult unit_info(void *face, int32_t index, UnitInfo *info) {
    const vst3 *me = vst3_of(face);
    if (index < 0 || index >= unit_count(face) || !info) return kInvalidArgument;
    memset(info, 0, sizeof *info);
    info->id = index;
    info->parentUnitId = index ? kRootUnitId : kNoParentUnitId;
    info->programListId = !index && presets(me) > 1 ? PROGRAM_LIST : kNoProgramListId;
    const jawari_bank *bank = plugin_bank(me->plugin);
    vst3_wide(info->name, 128, index ? jawari_preset_of(bank, index - 1)->name : jawari_bank_name(bank));
    return kResultOk;
}

static int32_t program_lists(void *face) { return presets(vst3_of(face)) > 1; }

static tresult program_list(void *face, int32_t index, ProgramListInfo *info) {
    if (index < 0 || index >= program_lists(face) || !info) return kInvalidArgument;
    memset(info, 0, sizeof *info);
    info->id = PROGRAM_LIST;
    vst3_wide(info->name, 128, "Presets");
    info->programCount = presets(vst3_of(face));
    return kResultOk;
}

static tresult program_name(void *face, int32_t list, int32_t program, String128 name) {
    const vst3 *me = vst3_of(face);
    if (list != PROGRAM_LIST || !program_lists(face) || program < 0 || program >= presets(me) || !name) return kInvalidArgument;
    vst3_wide(name, 128, jawari_preset_of(plugin_bank(me->plugin), program)->name);
    return kResultOk;
}

static tresult program_info(void *face, int32_t list, int32_t program, const char *attribute, String128 value) {
    (void)face, (void)list, (void)program, (void)attribute, (void)value;
    return kResultFalse;
}

static tresult no_pitch_names(void *face, int32_t list, int32_t program) {
    (void)face, (void)list, (void)program;
    return kResultFalse;
}

static tresult no_pitch_name(void *face, int32_t list, int32_t program, int16_t pitch, String128 name) {
    (void)face, (void)list, (void)program, (void)pitch, (void)name;
    return kResultFalse;
}

static int32_t selected_unit(void *face) {
    (void)face;
    return kRootUnitId;
}

static tresult select_unit(void *face, int32_t unit) { return unit >= 0 && unit < unit_count(face) ? kResultOk : kInvalidArgument; }

static tresult unit_by_bus(void *face, int32_t media, int32_t direction, int32_t bus, int32_t channel, int32_t *unit) {
    (void)face, (void)direction, (void)channel;
    if (media < kAudio || media > kEvent || bus != 0 || !unit) return kInvalidArgument;
    *unit = kRootUnitId;
    return kResultOk;
}

static tresult no_program_data(void *face, int32_t list, int32_t program, const IBStream **data) {
    (void)face, (void)list, (void)program, (void)data;
    return kNotImplemented;
}

const IUnitInfo vst3_units = {
    VST3_COMMON,
    .getUnitCount = unit_count,
    .getUnitInfo = unit_info,
    .getProgramListCount = program_lists,
    .getProgramListInfo = program_list,
    .getProgramName = program_name,
    .getProgramInfo = program_info,
    .hasProgramPitchNames = no_pitch_names,
    .getProgramPitchName = no_pitch_name,
    .getSelectedUnit = selected_unit,
    .selectUnit = select_unit,
    .getUnitByBus = unit_by_bus,
    .setUnitProgramData = no_program_data,
};

/* ---- note expressions: tuning and brightness; pressure is an event of its own ---- */

static int32_t expression_count(void *face, int32_t bus, int16_t channel) {
    (void)face;
    return bus == 0 && channel >= 0 && channel < 16 ? 2 : 0;
}

static tresult expression_info(void *face, int32_t bus, int16_t channel, int32_t index, NoteExpressionTypeInfo *info) {
    if (index < 0 || index >= expression_count(face, bus, channel) || !info) return kInvalidArgument;
    memset(info, 0, sizeof *info);
    const bool tuning = index == 0;
    info->typeId = tuning ? kTuningTypeID : kBrightnessTypeID;
    vst3_wide(info->title, 128, tuning ? "Tuning" : "Brightness");
    vst3_wide(info->shortTitle, 128, tuning ? "Tune" : "Bright");
    vst3_wide(info->units, 128, tuning ? "semitones" : "");
    info->unitId = -1;
    info->valueDesc = (NoteExpressionValueDescription){0.5, 0.0, 1.0, 0};
    info->associatedParameterId = UINT32_MAX;
    info->flags = tuning ? kIsBipolar : 0;
    return kResultOk;
}

static tresult text_of_expression(void *face, int32_t bus, int16_t channel, uint32_t type, double value, String128 text) {
    char narrow[32] = "";
    if (!expression_count(face, bus, channel) || !text) return kInvalidArgument;
    if (type == kTuningTypeID) {
        const double cents = round(24000.0 * (within(value) - 0.5));
        if (cents > 0.0) *narrow = '+';
        const size_t sign = cents > 0.0;
        plugin_write_number(narrow + sign, sizeof narrow - sign, cents / 100.0);
    } else if (type == kBrightnessTypeID)
        snprintf(narrow, sizeof narrow, "%.0f", 127.0 * within(value));
    else
        return kResultFalse;
    vst3_wide(text, 128, narrow);
    return kResultOk;
}

static tresult expression_of_text(void *face, int32_t bus, int16_t channel, uint32_t type, const int16_t *text, double *value) {
    char narrow[64];
    double number;
    if (!expression_count(face, bus, channel) || !text || !value) return kInvalidArgument;
    vst3_narrow(narrow, sizeof narrow, text);
    if (!plugin_read_number(narrow + strspn(narrow, " \t"), &number) || !isfinite(number)) return kResultFalse;
    if (type != kTuningTypeID && type != kBrightnessTypeID) return kResultFalse;
    *value = within(type == kTuningTypeID ? number / 240.0 + 0.5 : number / 127.0);
    return kResultOk;
}

const INoteExpressionController vst3_expressions = {
    VST3_COMMON,
    .getNoteExpressionCount = expression_count,
    .getNoteExpressionInfo = expression_info,
    .getNoteExpressionStringByValue = text_of_expression,
    .getNoteExpressionValueByString = expression_of_text,
};
