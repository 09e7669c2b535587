/* plugin_text.c: values as hosts show them, and knobs. The decimal point is a point in every locale. */
#include <ctype.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "plugin_rebuild.h"

enum { DIGITS = 6 }; /* significant ones, of which those at the end are left out where they are 0 */

void plugin_write_number(char *text, size_t room, double value) {
    double magnitude = fmin(fabs(value), 1e15);
    int decimals = magnitude > 0.0 ? DIGITS - 1 - (int)floor(log10(magnitude)) : 0;
    decimals = decimals < 0 ? 0 : decimals > 9 ? 9 : decimals;
    long long scale = 1;
    for (int k = 0; k < decimals; k++)
        scale *= 10;
    long long scaled = llround(magnitude * (double)scale);
    while (decimals > 0 && scaled % 10 == 0) {
        scaled /= 10;
        scale /= 10;
        decimals--;
    }
    const char *sign = value < 0.0 && scaled > 0 ? "-" : "";
    if (decimals > 0)
        snprintf(text, room, "%s%lld.%0*lld", sign, scaled / scale, decimals, scaled % scale);
    else
        snprintf(text, room, "%s%lld", sign, scaled);
}

static const char *without_space(const char *text) {
    while (isspace((unsigned char)*text))
        text++;
    return text;
}

const char *plugin_read_number(const char *text, double *value) {
    bool negative = *text == '-';
    if (*text == '-' || *text == '+')
        text++;
    double mantissa = 0.0;
    int digits = 0, exponent = 0;
    bool fraction = false;
    for (;; text++) {
        if (isdigit((unsigned char)*text)) {
            if (mantissa < 1e15) {
                mantissa = 10.0 * mantissa + (*text - '0');
                exponent -= fraction;
            } else
                exponent += !fraction;
            digits++;
        } else if ((*text == '.' || *text == ',') && !fraction)
            fraction = true;
        else
            break;
    }
    if (digits == 0)
        return NULL;
    if ((*text == 'e' || *text == 'E') &&
        (isdigit((unsigned char)text[1]) || ((text[1] == '-' || text[1] == '+') && isdigit((unsigned char)text[2])))) {
        bool down = text[1] == '-';
        int given = 0;
        for (text += isdigit((unsigned char)text[1]) ? 1 : 2; isdigit((unsigned char)*text); text++)
            given = given < 1000 ? 10 * given + (*text - '0') : given;
        exponent += down ? -given : given;
    }
    exponent = exponent < -400 ? -400 : exponent > 400 ? 400 : exponent;
    double power = pow(10.0, abs(exponent));
    *value = exponent < 0 ? mantissa / power : mantissa * power;
    if (negative)
        *value = -*value;
    return text;
}

static bool same_text(const char *a, const char *b) {
    for (; *a && *b; a++, b++)
        if (tolower((unsigned char)*a) != tolower((unsigned char)*b))
            return false;
    return *a == *b;
}

/* What may stand for a unit where its own letters are hard to type. */
static bool is_unit(const char *text, const char *unit) {
    if (!*text || same_text(text, unit))
        return true;
    return (!strcmp(unit, "µm") && same_text(text, "um")) || (!strcmp(unit, "×") && same_text(text, "x"));
}

bool plugin_text(const plugin *p, uint32_t k, double value, char *text, size_t room) {
    const plugin_parameter *q = plugin_parameter_of(p, k);
    if (!q || !isfinite(value) || room == 0)
        return false;
    value = plugin_kept(q, value);
    if (q->setup) {
        plugin_rebuild_text(p, k, value, text, room);
        return true;
    }
    char whole[128];
    if (q->bypass)
        plugin_copy_text(whole, sizeof whole, value > 0.0 ? "on" : "off");
    else if (q->texts[0])
        plugin_copy_text(whole, sizeof whole, q->texts[(int32_t)value]);
    else if (q->program)
        plugin_copy_text(whole, sizeof whole, jawari_preset_of(p->bank, (int32_t)value)->name);
    else {
        char number[48];
        plugin_write_number(number, sizeof number, value);
        snprintf(whole, sizeof whole, "%s%s%s", number, *q->unit ? " " : "", q->unit);
    }
    plugin_copy_text(text, room, whole);
    return true;
}

bool plugin_number(const plugin *p, uint32_t k, const char *text, double *value) {
    const plugin_parameter *q = plugin_parameter_of(p, k);
    if (!q || !text || !value)
        return false;
    char given[128];
    text = without_space(text);
    const char *remark = q->setup ? strstr(text, " (") : NULL;
    size_t length = remark ? (size_t)(remark - text) : strlen(text);
    while (length > 0 && isspace((unsigned char)text[length - 1]))
        length--;
    if (length >= sizeof given)
        return false;
    memcpy(given, text, length);
    given[length] = 0;
    if (q->bypass && (same_text(given, "on") || same_text(given, "off"))) {
        *value = same_text(given, "on");
        return true;
    }
    for (int32_t which = 0; q->texts[0] && which <= (int32_t)q->maximum; which++)
        if (same_text(given, q->texts[which])) {
            *value = which;
            return true;
        }
    if (q->program)
        for (int32_t preset = 0; preset < jawari_presets(p->bank); preset++) {
            char name[sizeof given];
            plugin_copy_text(name, sizeof name, jawari_preset_of(p->bank, preset)->name);
            if (same_text(given, name)) {
                *value = preset;
                return true;
            }
        }
    double number;
    const char *end = plugin_read_number(given, &number);
    if (!end || !isfinite(number) || !is_unit(without_space(end), q->unit))
        return false;
    *value = plugin_kept(q, number);
    return true;
}

double plugin_at(const plugin_parameter *q, double position) {
    position = fmin(fmax(position, 0.0), 1.0);
    double low = q->minimum, high = q->maximum;
    if (position == 1.0)
        return high;
    if (q->curve == JAWARI_RATIO && low > 0.0)
        return plugin_kept(q, low * pow(high / low, position));
    return plugin_kept(q, low + (high - low) * (q->curve == JAWARI_SQUARE ? position * position : position));
}

double plugin_position(const plugin_parameter *q, double value) {
    value = plugin_kept(q, value);
    double low = q->minimum, high = q->maximum;
    if (!(high > low))
        return 0.0;
    double share = (value - low) / (high - low);
    if (q->curve == JAWARI_RATIO && low > 0.0)
        share = log(value / low) / log(high / low);
    else if (q->curve == JAWARI_SQUARE)
        share = sqrt(share);
    return fmin(share, 1.0);
}
