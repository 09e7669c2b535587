/* plugin_state.c: what a host keeps of an instance.
 *
 *     "jawariP\n", format (u32), size of all (u64)
 *     sections: kind (u32), size (u64), that many bytes
 *     CRC-32 of all before (u32)
 *
 * BANK: the id of the plugin's bank.
 * VALUES: how many (u32); of each the length of its id (u16), the id, its value (f64).
 *
 * All is little-endian. Sections of unknown kind are passed over, so that later versions may add some; the format's number is
 * for what cannot be read that way. Kinds 2 and 4 are taken: up to version 0.20 they held what sounded.
 */
#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "checksum.h"
#include "plugin_rebuild.h"

static const char MAGIC[] = "jawariP\n";
enum { MAGIC_BYTES = 8, FORMAT = 1, VALUES = 1, BANK = 3 };
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

/* ---- writing ---- */

static size_t size_of_values(const plugin *p) {
    size_t size = 4;
    for (uint32_t k = 0; k < p->count; k++)
        size += 2 + strlen(p->parameters[k].id) + 8;
    return size;
}

static uint8_t *put_section(uint8_t *at, uint32_t kind, size_t size) { return put_whole(put_whole(at, kind, 4), size, 8); }

void *plugin_save(const plugin *p, size_t *written) {
    const char *bank = jawari_bank_id(p->bank);
    const size_t of_bank = strlen(bank), of_values = size_of_values(p);
    const size_t size = HEAD + SECTION_HEAD + of_bank + SECTION_HEAD + of_values + SUM;
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
    put_whole(at, crc32_of(0, data, size - SUM), SUM);
    *written = size;
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
    }
    return true;
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
    double *values = malloc(p->count * sizeof *values);
    for (uint32_t k = 0; values && k < p->count; k++)
        values[k] = p->parameters[k].initial;
    contents c = {.values = values};
    const bool read = values && read_state(p, sections, &c);
    const bool other = read && of_another(p, &c);
    if (!read || (other && !c.ours)) {
        const bool made = values != NULL;
        free(values);
        if (read)
            return refuse(why, "this state belongs to another plugin (%.*s, this is %s); load it there, or another one here",
                          (int)(c.bank_length < 72 ? c.bank_length : 72), c.bank, jawari_bank_id(p->bank));
        return refuse(why, made ? "this state contradicts itself; load an older copy"
                                : "there is not enough memory to load this state");
    }
    if (other && p->program >= 0) /* there it is the number of another preset */
        values[p->program] = p->parameters[p->program].initial;
    for (uint32_t k = 0; k < p->count; k++)
        plugin_store(p, k, values[k]);
    free(values);
    atomic_store(&p->loaded, true);
    plugin_rebuild_loaded(p);
    return true;
}
