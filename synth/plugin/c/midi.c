/* Messages of MIDI as events; what system exclusive ones mean is told in synth/midi/sysex.py. */
#include <string.h>
#include "jawari.h"

enum { FINE = 1 << 14, VALUE_BYTES = 10, NAME_BYTES = 16 };

/* Where events go: what does not fit is left out. */
struct sink {
    int64_t frame;
    jawari_event *events;
    int32_t room, count;
};

static void give(struct sink *to, int32_t kind, int32_t channel, int32_t a, int32_t b, double value) {
    if (to->count < to->room)
        to->events[to->count++] = (jawari_event){to->frame, kind, channel, a, b, value};
}

/* A key's pitch of three bytes: semitone, and 14 bits of its fraction. 7F 7F 7F changes nothing. */
static void give_tuning(struct sink *to, int32_t key, const uint8_t *pitch, int32_t at_once) {
    if (pitch[0] == 0x7f && pitch[1] == 0x7f && pitch[2] == 0x7f)
        return;
    give(to, JAWARI_TUNING, 0, key, at_once, pitch[0] + (double)(pitch[1] << 7 | pitch[2]) / (double)FINE);
}

static double value_of(const uint8_t *bytes) {
    uint64_t bits = 0;
    double value;
    for (int k = 0; k < VALUE_BYTES; k++)
        bits = bits << 7 | bytes[k];
    memcpy(&value, &bits, sizeof value);
    return value;
}

static void read_ours(struct sink *to, const uint8_t *body, size_t size) {
    if (size == 4 + VALUE_BYTES && body[0] == 0x01)
        give(to, JAWARI_PARAMETER, body[1] << 7 | body[2], body[3], 0, value_of(body + 4));
    else if (size == 3 + VALUE_BYTES && body[0] == 0x02 && body[2] <= 1)
        give(to, JAWARI_TUNING, 0, body[1], body[2], value_of(body + 3));
}

/* All 128 keys, with a checksum. */
static void read_bulk(struct sink *to, const uint8_t *data, size_t size) {
    uint8_t sum = 0;
    if (size != 5 + NAME_BYTES + 3 * 128 + 1)
        return;
    for (size_t k = 0; k + 1 < size; k++)
        sum ^= data[k];
    if ((sum & 0x7f) != data[size - 1])
        return;
    for (int32_t key = 0; key < 128; key++)
        give_tuning(to, key, data + 5 + NAME_BYTES + 3 * key, 0);
}

/* Count, then key and pitch of each. */
static void read_changes(struct sink *to, const uint8_t *body, size_t size, int32_t at_once) {
    if (size < 1 || size != 1 + 4 * (size_t)body[0])
        return;
    for (size_t at = 1; at < size; at += 4)
        give_tuning(to, body[at], body + at + 1, at_once);
}

/* Three bytes of channels, then how far every C, C♯, … B stands off equal temperament. */
static void read_octave(struct sink *to, const uint8_t *body, size_t size, size_t width, int32_t at_once) {
    if (size != 3 + 12 * width || (body[0] | body[1] | body[2]) == 0)
        return;
    for (int32_t key = 0; key < 128; key++) {
        const uint8_t *step = body + 3 + width * (size_t)(key % 12);
        const double offset = width == 1 ? (step[0] - 64) / 100.0 : ((step[0] << 7 | step[1]) - 8192) / 8192.0;
        give(to, JAWARI_TUNING, 0, key, at_once, key + offset);
    }
}

/* Without F0 and F7. */
static void read_exclusive(struct sink *to, const uint8_t *data, size_t size) {
    for (size_t k = 0; k < size; k++)
        if (data[k] > 0x7f)
            return;
    if (size >= 3 && data[0] == 0x7d && data[1] == 0x4a && data[2] == 0x57) {
        read_ours(to, data + 3, size - 3);
        return;
    }
    if (size < 4 || (data[0] != 0x7e && data[0] != 0x7f) || data[2] != 0x08)
        return;
    const int32_t at_once = data[0] == 0x7f;
    const uint8_t *body = data + 4;
    size -= 4;
    switch (data[3]) {
    case 0x01:
        if (!at_once)
            read_bulk(to, data, size + 4);
        break;
    case 0x02: /* after the tuning's number */
        if (at_once && size >= 1)
            read_changes(to, body + 1, size - 1, at_once);
        break;
    case 0x07: /* after its bank and number */
        if (size >= 2)
            read_changes(to, body + 2, size - 2, at_once);
        break;
    case 0x08:
        read_octave(to, body, size, 1, at_once);
        break;
    case 0x09:
        read_octave(to, body, size, 2, at_once);
        break;
    default:
        break;
    }
}

static void read_short(struct sink *to, const uint8_t *bytes, size_t size) {
    const int32_t channel = bytes[0] & 0x0f, a = size > 1 ? bytes[1] : 0, b = size > 2 ? bytes[2] : 0;
    const uint8_t message = bytes[0] >> 4;
    const size_t needed = message == 0xc || message == 0xd ? 2 : 3;
    if (size != needed || a > 0x7f || b > 0x7f)
        return;
    switch (message) {
    case 0x8:
        give(to, JAWARI_NOTE_OFF, channel, a, b, 0.0);
        break;
    case 0x9:
        if (b == 0)
            give(to, JAWARI_NOTE_OFF, channel, a, 64, 0.0);
        else
            give(to, JAWARI_NOTE_ON, channel, a, b, 0.0);
        break;
    case 0xa:
        give(to, JAWARI_KEY_PRESSURE, channel, a, b, 0.0);
        break;
    case 0xb:
        give(to, JAWARI_CONTROL, channel, a, b, 0.0);
        break;
    case 0xc:
        give(to, JAWARI_PROGRAM, channel, a, 0, 0.0);
        break;
    case 0xd:
        give(to, JAWARI_PRESSURE, channel, 0, a, 0.0);
        break;
    default:
        give(to, JAWARI_BEND, channel, a + 128 * b - 8192, 0, 0.0);
        break;
    }
}

int32_t jawari_midi(const uint8_t *bytes, size_t size, int64_t frame, jawari_event *events, int32_t room) {
    struct sink to = {frame, events, room, 0};
    if (bytes == NULL || size == 0)
        return 0;
    if (bytes[0] == 0xf0) {
        if (size >= 2 && bytes[size - 1] == 0xf7)
            read_exclusive(&to, bytes + 1, size - 2);
    } else if (bytes[0] >= 0x80 && bytes[0] < 0xf0) {
        /* some hosts hand over three bytes of every message */
        const size_t needed = (bytes[0] & 0xe0) == 0xc0 ? 2 : 3;
        read_short(&to, bytes, size > needed && size <= 3 ? needed : size);
    }
    return to.count;
}
