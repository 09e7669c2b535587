/* Banks: bytes, checked before anything in them is used, shared by all engines. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "checksum.h"
#include "core.h"
#include "drone_score.h"

struct bank_header {
    char magic[8];
    uint32_t version, checksum;
    uint64_t size, tables_end;
    char kernels[32];
    uint8_t uid[16];
    char id[72], name[96];
    uint32_t presets, parameters, functions, rates;
    uint64_t presets_at, parameters_at, functions_at, rates_at, setup_at, recipe_at, drone_at;
    uint32_t setup, recipe;
    uint64_t drone;
};
struct bank_preset {
    char id[72], name[96], description[256];
    int32_t lowest, highest;
};
struct bank_parameter {
    int32_t part, index, curve, unused;
    double minimum, maximum, initial, smoothing_s;
    char id[48], name[96], unit[16];
};
struct bank_function {
    char name[96];
};

_Static_assert(sizeof(struct bank_header) == 336, "as bankfile.HEADER");
_Static_assert(sizeof(struct bank_preset) == 432, "as bankfile.PRESET");
_Static_assert(sizeof(struct bank_parameter) == 208, "as bankfile.PARAMETER");
_Static_assert(sizeof(struct bank_rate) == 168 + 24 * PLACES, "as bankfile.RATE");
_Static_assert(sizeof(struct bank_relocation) == 24, "as addresses.RELOCATION");

static const char MAGIC[8] = {'J', 'A', 'W', 'A', 'R', 'I', 'B', 'K'};
enum { VERSION = 5, MOST_PRESETS = 128, MOST_PARAMETERS = 128 * 64, MOST_FUNCTIONS = 4096, MOST_RATES = 32 };
/* larger than any bank: sums of two do not overflow */
#define MOST_BYTES ((uint64_t)1 << 40)
/* of an engine; that of the largest preset takes some megabytes */
#define MOST_MEMORY ((uint64_t)1 << 31)

/* Guards `holds` of every bank, and `own`. */
static system_guard holding;
static jawari_bank *own;

/* Whether `count` things of `size` bytes lie from `at` on before `end`, on a border of eight bytes. */
static bool fits(uint64_t at, uint64_t count, uint64_t size, uint64_t end) {
    return at % 8 == 0 && at <= end && end <= MOST_BYTES && count <= (end - at) / size;
}

static bool ended(const char *text, size_t room) { return memchr(text, 0, room) != NULL; }

static bool refuse(char *why, const char *path, const char *what) {
    core_say(why, "%s holds no bank that can be played: %s; export it again", path, what);
    return false;
}

static bool check_tables(const struct bank_header *h, uint64_t room, const char *path, char *why) {
    if (memcmp(h->magic, MAGIC, sizeof MAGIC) != 0)
        return refuse(why, path, "it does not begin like one");
    if (h->version != VERSION) {
        core_say(why, "the bank in %s is of version %u, this library reads %u; export it again with a program of this version", path,
                 h->version, (unsigned)VERSION);
        return false;
    }
    if (h->size > room)
        return refuse(why, path, "it was cut off");
    if (h->tables_end > h->size || h->tables_end < sizeof *h)
        return refuse(why, path, "its tables lie outside of it");
    struct bank_header blank = *h;
    blank.checksum = 0;
    uint32_t sum = crc32_of(0, &blank, sizeof blank);
    sum = crc32_of(sum, (const uint8_t *)h + sizeof *h, (size_t)h->tables_end - sizeof *h);
    if (sum != h->checksum)
        return refuse(why, path, "it was changed (its checksum is wrong)");
    if (!ended(h->kernels, sizeof h->kernels) || !ended(h->id, sizeof h->id) || !ended(h->name, sizeof h->name))
        return refuse(why, path, "a name in it has no end");
    if (strcmp(h->kernels, jawari_kernels_version()) != 0) {
        core_say(why, "the bank in %s was made for another version of the library (kernels %s, these are %s); export it again", path,
                 h->kernels, jawari_kernels_version());
        return false;
    }
    if (h->presets < 1 || h->presets > MOST_PRESETS || h->parameters > MOST_PARAMETERS || h->setup > MOST_PARAMETERS || h->functions > MOST_FUNCTIONS ||
        h->rates < 1 || h->rates > MOST_RATES)
        return refuse(why, path, "it counts what cannot be");
    if (!fits(h->presets_at, h->presets, sizeof(struct bank_preset), h->tables_end) ||
        !fits(h->parameters_at, h->parameters, sizeof(struct bank_parameter), h->tables_end) ||
        !fits(h->setup_at, h->setup, sizeof(struct bank_parameter), h->tables_end) ||
        !fits(h->functions_at, h->functions, sizeof(struct bank_function), h->tables_end) ||
        !fits(h->rates_at, h->rates, sizeof(struct bank_rate), h->tables_end) ||
        (h->drone_at && !fits(h->drone_at, h->drone, 1, h->tables_end)))
        return refuse(why, path, "a table lies outside of it");
    return true;
}

static bool check_rate(const struct bank_header *h, const struct bank_rate *r, double before) {
    if (!(r->rate_hz > before && r->rate_hz <= 1e7) || r->latency < 0 || r->latency > 1 << 24 || r->tail < 0)
        return false;
    if (r->at % 64 != 0 || !fits(r->at, r->size, 1, h->size) || r->constants_at % 64 != 0)
        return false;
    if (!fits(r->constants_at, r->constants, 1, r->size) || !fits(r->core_at, r->core_stored, 1, r->size) ||
        !fits(r->thread_at, r->thread_stored, 1, r->size) ||
        !fits(r->relocations_at, r->relocations, sizeof(struct bank_relocation), r->size))
        return false;
    if (r->core_stored > r->core || r->core > MOST_MEMORY || r->thread_stored > r->thread || r->thread > MOST_MEMORY)
        return false;
    if (r->sounding % 8 != 0 || r->sounding_end % 8 != 0 || r->sounding > r->sounding_end || r->sounding_end > r->core)
        return false;
    if (!fits(r->thread_table, 1, 8, r->thread) || !fits(r->pitch, 128, 8, r->constants))
        return false;
    for (int k = 0; k < PLACES; k++) {
        const struct bank_place *p = &r->places[k];
        if (p->count < 1 || p->stride % 8 != 0 || p->stride < 8 || !fits(p->at, 1, 8, r->core) ||
            p->count - 1 > (r->core - 8 - p->at) / p->stride)
            return false;
    }
    const struct bank_place *places = r->places;
    const uint64_t lines = places[PLACE_AWAKE].count;
    if (lines != places[PLACE_NOTE].count || lines != places[PLACE_CHANNEL].count || lines != places[PLACE_IDLE].count)
        return false;
    if (r->strings < 1 || (uint64_t)r->strings > lines)
        return false;
    return places[PLACE_TUNING].count == 128 && places[PLACE_PROGRAMS].count == 16 &&
           places[PLACE_PARAMETERS].count == h->presets;
}

/* A table of parameters, from number `first` of all on. */
static bool read_parameters(jawari_bank *bank, uint32_t first, uint32_t count, uint64_t at, const char *path, char *why) {
    const struct bank_parameter *table = (const void *)(bank->data + at);
    for (uint32_t k = 0; k < count; k++) {
        const struct bank_parameter *p = &table[k];
        if (!ended(p->id, sizeof p->id) || !ended(p->name, sizeof p->name) || !ended(p->unit, sizeof p->unit))
            return refuse(why, path, "a name in it has no end");
        if (p->part < 0 || p->part >= bank->presets || p->index < 0 || p->index >= 64 || p->curve < JAWARI_LINEAR ||
            p->curve > JAWARI_SQUARE || !(p->minimum <= p->initial && p->initial <= p->maximum) || !isfinite(p->minimum) ||
            !isfinite(p->maximum) || !isfinite(p->smoothing_s))
            return refuse(why, path, "a parameter in it cannot be");
        bank->parameter[first + k] = (jawari_parameter){p->part,    p->index,   p->curve,   p->id,         p->name, p->unit,
                                                        p->minimum, p->maximum, p->initial, p->smoothing_s};
    }
    return true;
}

/* Fills in what is read of the tables. */
static bool read_tables(jawari_bank *bank, const char *path, char *why) {
    const struct bank_header *h = (const void *)bank->data;
    const struct bank_preset *presets = (const void *)(bank->data + h->presets_at);
    const struct bank_function *functions = (const void *)(bank->data + h->functions_at);
    bank->rate = (const void *)(bank->data + h->rates_at);
    bank->presets = (int32_t)h->presets;
    bank->parameters = (int32_t)h->parameters;
    bank->setup = (int32_t)h->setup;
    bank->rates = (int32_t)h->rates;
    bank->functions = (int32_t)h->functions;
    bank->id = h->id;
    bank->name = h->name;
    bank->uid = h->uid;
    bank->checksum = h->checksum;
    if (h->drone_at) {
        bank->drone = (const void *)(bank->data + h->drone_at);
        if (!drone_score_fits(bank->drone, h->drone, h->presets))
            return refuse(why, path, "the drone in it cannot be");
    }
    bank->preset = calloc(h->presets, sizeof *bank->preset);
    bank->parameter = calloc((size_t)h->parameters + h->setup + 1, sizeof *bank->parameter);
    bank->function = calloc(h->functions + 1, sizeof *bank->function);
    bank->sound = calloc(h->rates, sizeof *bank->sound);
    if (!bank->preset || !bank->parameter || !bank->function || !bank->sound) {
        core_say(why, "no memory for the bank in %s; close other programs", path);
        return false;
    }
    for (uint32_t k = 0; k < h->presets; k++) {
        const struct bank_preset *p = &presets[k];
        if (!ended(p->id, sizeof p->id) || !ended(p->name, sizeof p->name) || !ended(p->description, sizeof p->description))
            return refuse(why, path, "a name in it has no end");
        bank->preset[k] = (jawari_preset){p->id, p->name, p->description, p->lowest, p->highest};
    }
    if (!read_parameters(bank, 0, h->parameters, h->parameters_at, path, why) ||
        !read_parameters(bank, h->parameters, h->setup, h->setup_at, path, why))
        return false;
    for (uint32_t k = 0; k < h->functions; k++) {
        if (!ended(functions[k].name, sizeof functions[k].name))
            return refuse(why, path, "a name in it has no end");
        bank->function[k] = core_find(functions[k].name);
        if (bank->function[k] == NULL) {
            core_say(why, "the bank in %s needs %s, which this library does not have; export it again with a program of this version",
                     path, functions[k].name);
            return false;
        }
    }
    double before = 0.0;
    for (uint32_t k = 0; k < h->rates; k++) {
        if (!check_rate(h, &bank->rate[k], before))
            return refuse(why, path, "what it has for a sample rate cannot be");
        before = bank->rate[k].rate_hz;
    }
    return true;
}

static void free_bank(jawari_bank *bank) {
    system_unmap(&bank->map);
    free(bank->preset);
    free(bank->parameter);
    free(bank->function);
    free(bank->sound);
    free(bank);
}

jawari_bank *bank_of_bytes(const uint8_t *bytes, uint64_t room, const char *name, char *why) {
    if (core_kernels(why) == NULL)
        return NULL;
    if (room < sizeof(struct bank_header)) {
        refuse(why, name, "it was cut off");
        return NULL;
    }
    jawari_bank *bank = calloc(1, sizeof *bank);
    if (bank == NULL) {
        core_say(why, "no memory for the bank in %s; close other programs", name);
        return NULL;
    }
    bank->data = bytes;
    bank->holds = 1;
    if (!check_tables((const void *)bytes, room, name, why) || !read_tables(bank, name, why)) {
        free_bank(bank);
        return NULL;
    }
    return bank;
}

jawari_bank *jawari_open_bytes(const void *data, size_t size, char *why) {
    if (data == NULL || (uintptr_t)data % JAWARI_BORDER != 0) {
        core_say(why, "no bytes on a border of %d were given; copy the bank to such a place", JAWARI_BORDER);
        return NULL;
    }
    return bank_of_bytes(data, size, "memory", why);
}

jawari_bank *bank_own(jawari_bank *(*open)(char *why), char *why) {
    system_lock(&holding);
    if (own != NULL)
        own->holds++;
    else
        own = open(why);
    jawari_bank *bank = own;
    system_unlock(&holding);
    return bank;
}

jawari_bank *jawari_hold(jawari_bank *bank) {
    if (bank != NULL) {
        system_lock(&holding);
        bank->holds++;
        system_unlock(&holding);
    }
    return bank;
}

void jawari_close(jawari_bank *bank) {
    if (bank == NULL)
        return;
    system_lock(&holding);
    const bool last = --bank->holds == 0;
    if (last && bank == own)
        own = NULL;
    system_unlock(&holding);
    if (last)
        free_bank(bank);
}

/* Whether every word that will be written, and all that it will lead to, lies where it should. */
static bool check_relocations(const jawari_bank *bank, const struct bank_rate *r) {
    const struct bank_relocation *relocation = (const void *)(bank->data + r->at + r->relocations_at);
    for (uint64_t k = 0; k < r->relocations; k++) {
        const struct bank_relocation *x = &relocation[k];
        const uint64_t room = x->region == TO_CORE ? r->core : x->region == TO_THREAD ? r->thread : 0;
        if (!fits(x->word, 1, 8, room))
            return false;
        if (x->region == TO_CORE && x->word + 8 > r->sounding && x->word < r->sounding_end)
            return false; /* a reset writes there */
        const uint64_t most = x->to == TO_CONSTANT   ? r->constants
                              : x->to == TO_CORE     ? r->core
                              : x->to == TO_THREAD   ? r->thread
                              : x->to == TO_FUNCTION ? (uint64_t)bank->functions
                                                     : 0;
        if (x->target >= most)
            return false;
    }
    return true;
}

const struct bank_rate *bank_block(jawari_bank *bank, double rate_hz, char *why) {
    for (int32_t k = 0; k < bank->rates; k++) {
        const struct bank_rate *r = &bank->rate[k];
        if (!(fabs(r->rate_hz - rate_hz) < 0.5))
            continue;
        if (!atomic_load(&bank->sound[k])) {
            if (crc32_of(0, bank->data + r->at, (size_t)r->size) != r->checksum || !check_relocations(bank, r)) {
                core_say(why, "the bank of %s was changed (the checksum for %g Hz is wrong); export it again", bank->name, rate_hz);
                return NULL;
            }
            atomic_store(&bank->sound[k], true);
        }
        return r;
    }
    char list[256] = "";
    for (int32_t k = 0, at = 0; k < bank->rates && at < (int32_t)sizeof list - 16; k++)
        at += snprintf(list + at, sizeof list - (size_t)at, "%s%g", k == 0 ? "" : ", ", bank->rate[k].rate_hz);
    core_say(why, "%s was compiled for %s Hz, not for %g; set the host to one of these, or export it with this rate", bank->name,
             list, rate_hz);
    return NULL;
}

const struct drone_score *bank_drone(const jawari_bank *bank) { return bank->drone; }
int32_t jawari_presets(const jawari_bank *bank) { return bank == NULL ? 0 : bank->presets; }
const jawari_preset *jawari_preset_of(const jawari_bank *bank, int32_t k) {
    return bank == NULL || k < 0 || k >= bank->presets ? NULL : &bank->preset[k];
}
const char *jawari_bank_id(const jawari_bank *bank) { return bank == NULL ? "" : bank->id; }
const char *jawari_bank_name(const jawari_bank *bank) { return bank == NULL ? "" : bank->name; }
const uint8_t *jawari_bank_uid(const jawari_bank *bank) { return bank == NULL ? NULL : bank->uid; }
int32_t jawari_strings(const jawari_bank *bank) { return bank == NULL ? 0 : (int32_t)bank->rate[0].strings; }
int32_t jawari_rates(const jawari_bank *bank) { return bank == NULL ? 0 : bank->rates; }
double jawari_rate_of(const jawari_bank *bank, int32_t k) {
    return bank == NULL || k < 0 || k >= bank->rates ? 0.0 : bank->rate[k].rate_hz;
}
int32_t jawari_parameters(const jawari_bank *bank) { return bank == NULL ? 0 : bank->parameters; }
const jawari_parameter *jawari_parameter_of(const jawari_bank *bank, int32_t k) {
    return bank == NULL || k < 0 || k >= bank->parameters ? NULL : &bank->parameter[k];
}
int32_t jawari_setup_numbers(const jawari_bank *bank) { return bank == NULL ? 0 : bank->setup; }
const jawari_parameter *jawari_setup_number_of(const jawari_bank *bank, int32_t k) {
    return bank == NULL || k < 0 || k >= bank->setup ? NULL : &bank->parameter[bank->parameters + k];
}
uint32_t jawari_bank_checksum(const jawari_bank *bank) { return bank == NULL ? 0 : bank->checksum; }
