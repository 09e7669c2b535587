/* plugin_state.c: what a host keeps of an instance.
 *
 *     "jawariP\n", format (u32), size of all (u64)
 *     sections: kind (u32), size (u64), that many bytes
 *     CRC-32 of all before (u32)
 *
 * BANK: the id of the plugin's bank.
 * VALUES: how many (u32); of each the length of its id (u16), the id, its value (f64).
 * SOUND: how many values (u32) and those that the engine has been told; 128 pitches (f64), 128 flags (u8); the engine's own bytes.
 * DRONE: where the drone is that goes with what sounds: the words of `drone_place`.
 *
 * All is little-endian. Sections of unknown kind are passed over, so that later versions may add some; the format's number is
 * for what cannot be read that way.
 */
#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "checksum.h"
#include "plugin_rebuild.h"

static const char MAGIC[] = "jawariP\n";
enum { MAGIC_BYTES = 8,  FORMAT = 1, VALUES = 1, SOUND = 2, BANK = 3, DRONE = 4 };
enum { HEAD = 8 + 4 + 8, SECTION_HEAD = 4 + 8, SUM = 4 };

/* ---- bytes ---- */

static uint8_t *put_whole(uint8_t *at, uint64_t value, int bytes) {
    for (int k = 0; k < bytes; k++)
        *at++ = (uint8_t)(value >> (8 * k));
    return at;
}

static uint8_t *put_double(uint8_t *at, double value) {
    uint64_t bits;
    memcpy(&bits, &value, sizeof bits);
    return put_whole(at, bits, 8);
}

static uint8_t *put_bytes(uint8_t *at, const void *bytes, size_t size) {
    memcpy(at, bytes, size);
    return at + size;
}

/* What is yet to be read; nothing more after it has fallen short once. */
typedef struct reader {
    const uint8_t *at;
    size_t left;
    bool short_of;
} reader;

static const uint8_t *take(reader *r, uint64_t size) {
    if (r->short_of || size > r->left) {
        r->short_of = true;
        return NULL;
    }
    const uint8_t *here = r->at;
    r->at += size;
    r->left -= (size_t)size;
    return here;
}

static uint64_t take_whole(reader *r, size_t bytes) {
    const uint8_t *here = take(r, bytes);
    uint64_t value = 0;
    for (size_t k = bytes; here && k-- > 0;)
        value = value << 8 | here[k];
    return value;
}

static double take_double(reader *r) {
    uint64_t bits = take_whole(r, 8);
    double value;
    memcpy(&value, &bits, sizeof value);
    return value;
}

/* ---- a copy of what sounds ---- */

/* A copy beside the audio thread holds where no block began meanwhile. A host that renders without a pause leaves no
 * time for that: then the audio thread is asked to make it between two blocks. */
static void copy_sound(plugin *p, plugin_sound *sound) {
    enum { TRIES = 200, PATIENCE = 200, PAUSE_US = 200 };
    for (;;) {
        for (int k = 0; k < TRIES; k++) {
            unsigned before = atomic_load(&p->turn);
            if (before % 2 == 0) {
                plugin_copy_sound(p, sound);
                atomic_thread_fence(memory_order_acquire);
                if (atomic_load(&p->turn) == before)
                    return;
            }
            system_sleep_us(PAUSE_US);
        }
        plugin_request request = {.sound = sound};
        atomic_store(&p->request, &request);
        for (int k = 0; k < PATIENCE && !atomic_load(&request.done); k++)
            system_sleep_us(PAUSE_US);
        if (!atomic_exchange(&p->request, NULL)) { /* it has begun, or is done */
            while (!atomic_load(&request.done))
                system_yield();
            return;
        }
    }
}

/* Room for what an engine saves; false: there is not enough memory. */
static bool make_room(const plugin *p, plugin_sound *sound) {
    sound->room = jawari_most_saved(p->engine);
    sound->size = -1;
    sound->sent = malloc(p->count * sizeof *sound->sent);
    sound->bytes = malloc(sound->room ? sound->room : 1);
    return sound->sent && sound->bytes;
}

/* ---- writing ---- */

static size_t size_of_values(const plugin *p) {
    size_t size = 4;
    for (uint32_t k = 0; k < p->count; k++)
        size += 2 + strlen(p->parameters[k].id) + 8;
    return size;
}

static uint8_t *put_section(uint8_t *at, uint32_t kind, size_t size) { return put_whole(put_whole(at, kind, 4), size, 8); }

static uint8_t *write_state(const plugin *p, const plugin_sound *sound, size_t *written) {
    size_t of_values = size_of_values(p), of_sound = 0, of_drone = 0;
    if (sound && sound->has_drone)
        of_drone = 8 * DRONE_WORDS;
    if (sound)
        of_sound = 4 + 8 * (size_t)p->count + 9 * PLUGIN_KEYS + (size_t)sound->size;
    const char *bank = jawari_bank_id(p->bank);
    size_t of_bank = strlen(bank);
    size_t size = HEAD + SECTION_HEAD + of_bank + SECTION_HEAD + of_values + (sound ? SECTION_HEAD + of_sound : 0) +
                  (of_drone ? SECTION_HEAD + of_drone : 0) + SUM;
    uint8_t *data = malloc(size), *at = data;
    if (!data)
        return NULL;
    at = put_bytes(at, MAGIC, MAGIC_BYTES);
    at = put_whole(at, FORMAT, 4);
    at = put_whole(at, size, 8);
    at = put_bytes(put_section(at, BANK, of_bank), bank, of_bank);
    at = put_whole(put_section(at, VALUES, of_values), p->count, 4);
    for (uint32_t k = 0; k < p->count; k++) {
        size_t length = strlen(p->parameters[k].id);
        at = put_bytes(put_whole(at, length, 2), p->parameters[k].id, length);
        at = put_double(at, plugin_value(p, k));
    }
    if (sound) {
        at = put_whole(put_section(at, SOUND, of_sound), p->count, 4);
        for (uint32_t k = 0; k < p->count; k++)
            at = put_double(at, sound->sent[k]);
        for (int key = 0; key < PLUGIN_KEYS; key++)
            at = put_double(at, sound->pitches.tuned[key]);
        at = put_bytes(at, sound->pitches.bent, PLUGIN_KEYS);
        at = put_bytes(at, sound->bytes, (size_t)sound->size);
    }
    if (of_drone) {
        uint64_t words[DRONE_WORDS];
        memcpy(words, &sound->drone, sizeof words);
        at = put_section(at, DRONE, of_drone);
        for (size_t k = 0; k < DRONE_WORDS; k++)
            at = put_whole(at, words[k], 8);
    }
    put_whole(at, crc32_of(0, data, size - SUM), SUM);
    *written = size;
    return data;
}

void *plugin_save(plugin *p, size_t *size) {
    system_lock(&p->guard);
    plugin_sweep(p);
    uint8_t *data = NULL;
    /* a state that the audio thread has not taken over yet is what will sound; where it takes it over meanwhile, it stays
     * among the spent ones, which nobody frees without the guard */
    plugin_message *waiting = atomic_load(&p->incoming);
    if (waiting && waiting->sound.size > 0)
        data = write_state(p, &waiting->sound, size);
    else if (p->engine) {
        plugin_sound sound = {0};
        if (make_room(p, &sound)) {
            copy_sound(p, &sound);
            data = write_state(p, sound.size > 0 ? &sound : NULL, size);
        }
        free(sound.sent);
        free(sound.bytes);
    } else
        data = write_state(p, NULL, size);
    system_unlock(&p->guard);
    return data;
}

/* ---- reading ---- */

static bool refuse(char *why, const char *format, ...) {
    if (why) {
        va_list given;
        va_start(given, format);
        vsnprintf(why, JAWARI_WHY, format, given);
        va_end(given);
    }
    return false;
}

/* The sections of a state, as a reader; false with `why` for what is none. */
static bool open_state(const void *data, size_t size, reader *sections, char *why) {
    reader r = {data, size, false};
    const uint8_t *magic = take(&r, MAGIC_BYTES);
    if (!magic || memcmp(magic, MAGIC, MAGIC_BYTES))
        return refuse(why, "these %zu bytes are no state of this plugin; another program may have written them", size);
    const uint64_t format = take_whole(&r, 4), told = take_whole(&r, 8);
    if (!r.short_of && format != FORMAT)
        return refuse(why, "this state has format %llu, this version reads format %d; a newer version reads it",
                      (unsigned long long)format, FORMAT);
    if (r.short_of || told > size || told < HEAD + SUM)
        return refuse(why, "this state is cut off: %zu bytes of it are there; load an older copy", size);
    const size_t whole = (size_t)told;
    reader sum = {(const uint8_t *)data + whole - SUM, SUM, false};
    if (crc32_of(0, data, whole - SUM) != take_whole(&sum, SUM))
        return refuse(why, "this state was changed since it was saved (its checksum is another); load an older copy");
    *sections = (reader){r.at, whole - HEAD - SUM, false};
    return true;
}

/* What a state says, as far as it is read. */
typedef struct contents {
    const char *bank; /* id of its bank, not ended; NULL: it does not say */
    size_t bank_length;
    bool ours; /* it has a value for a preset that is in here */
    double *values;
    plugin_message *message; /* what sounds goes there */
    reader sound;            /* the section of it; at NULL: there is none */
    char why[JAWARI_WHY];    /* the engine's, where it refuses that */
} contents;

static bool read_values(const plugin *p, reader r, contents *c) {
    for (uint64_t left = take_whole(&r, 4); left > 0 && !r.short_of; left--) {
        const size_t length = (size_t)take_whole(&r, 2);
        const char *id = (const char *)take(&r, length);
        double value = take_double(&r);
        if (r.short_of || !isfinite(value))
            return false;
        int64_t k = plugin_named(p, id, length);
        if (k < 0)
            continue;
        c->values[k] = plugin_kept(&p->parameters[k], value);
        c->ours = c->ours || k < (int64_t)p->of_presets;
    }
    return !r.short_of;
}

/* What sounds, of a state of a plugin with as many parameters; it may be of the setup that its values say. That of others is left
 * out, and what the engine knows to be of another bank, rate or version. False: it is damaged, or there is no memory. */
static bool read_sound(const plugin *p, contents *c) {
    reader r = c->sound;
    plugin_sound *sound = &c->message->sound;
    if (take_whole(&r, 4) != p->count)
        return !r.short_of;
    sound->sent = malloc(p->count * sizeof *sound->sent);
    if (!sound->sent)
        return false;
    for (uint32_t k = 0; k < p->count; k++) {
        sound->sent[k] = take_double(&r);
        if (!isfinite(sound->sent[k]))
            return false;
    }
    for (int key = 0; key < PLUGIN_KEYS; key++)
        sound->pitches.tuned[key] = take_double(&r);
    const uint8_t *bent = take(&r, PLUGIN_KEYS);
    if (r.short_of)
        return false;
    for (int key = 0; key < PLUGIN_KEYS; key++)
        sound->pitches.bent[key] = bent[key] != 0;
    int32_t elsewhere;
    c->message->read = jawari_read(p->bank, r.at, r.left, &elsewhere, c->why);
    jawari_bank *wished = elsewhere ? plugin_rebuild_bank(p, jawari_saved_rate(r.at, r.left), c->values) : NULL;
    if (wished) {
        c->message->read = jawari_read(wished, r.at, r.left, &elsewhere, c->why);
        jawari_close(wished);
    }
    if (!c->message->read) {
        if (elsewhere)
            c->why[0] = 0;
        return elsewhere != 0;
    }
    sound->room = r.left;
    sound->bytes = malloc(r.left);
    if (!sound->bytes)
        return false;
    memcpy(sound->bytes, r.at, r.left);
    sound->size = (int64_t)r.left;
    return true;
}

static bool read_drone(const plugin *p, reader r, plugin_sound *sound) {
    uint64_t words[DRONE_WORDS];
    for (size_t k = 0; k < DRONE_WORDS; k++)
        words[k] = take_whole(&r, 8);
    sound->has_drone = !r.short_of && plugin_drone_place(p, words, &sound->drone);
    return sound->has_drone;
}

static bool read_state(const plugin *p, reader r, contents *c) {
    while (r.left > 0) {
        uint64_t kind = take_whole(&r, 4);
        const uint64_t size = take_whole(&r, 8);
        reader section = {take(&r, size), (size_t)size, false};
        if (r.short_of || (kind == VALUES && !read_values(p, section, c)))
            return false;
        if (kind == BANK) {
            c->bank = (const char *)section.at;
            c->bank_length = section.left;
        }
        if (kind == DRONE && p->drone.score && !read_drone(p, section, &c->message->sound))
            return false;
        if (kind == SOUND) {
            if (c->sound.at)
                return false;
            c->sound = section;
        }
    }
    return !c->sound.at || read_sound(p, c);
}

/* Whether it is the state of a plugin with another bank. */
static bool of_another(const plugin *p, const contents *c) {
    const char *mine = jawari_bank_id(p->bank);
    return c->bank && (c->bank_length != strlen(mine) || memcmp(c->bank, mine, c->bank_length) != 0);
}

bool plugin_load(plugin *p, const void *data, size_t size, char *why) {
    reader sections;
    if (!open_state(data, size, &sections, why))
        return false;
    plugin_message *m = calloc(1, sizeof *m);
    double *values = malloc(p->count * sizeof *values);
    bool made = m && values;
    for (uint32_t k = 0; made && k < p->count; k++)
        values[k] = p->parameters[k].initial;
    contents c = {.values = values, .message = m};
    const bool read = made && read_state(p, sections, &c);
    const bool other = read && of_another(p, &c);
    if (!read || (other && !c.ours)) {
        plugin_message_free(m);
        free(values);
        if (read)
            return refuse(why, "this state belongs to another plugin (%.*s, this is %s); load it there, or another one here",
                          (int)(c.bank_length < 72 ? c.bank_length : 72), c.bank, jawari_bank_id(p->bank));
        if (c.why[0])
            return refuse(why, "this state was changed since it was saved: %.380s; load an older copy", c.why);
        return refuse(why, made ? "this state contradicts itself, or memory is short; load an older copy"
                                : "there is not enough memory to load this state");
    }
    if (other && p->program >= 0) /* there it is the number of another preset */
        values[p->program] = p->parameters[p->program].initial;
    system_lock(&p->guard);
    plugin_sweep(p);
    for (uint32_t k = 0; k < p->count; k++)
        plugin_store(p, k, values[k]);
    system_unlock(&p->guard);
    plugin_rebuild_loaded(p);
    system_lock(&p->guard);
    plugin_message_free(atomic_exchange(&p->incoming, m));
    system_unlock(&p->guard);
    free(values);
    return true;
}
