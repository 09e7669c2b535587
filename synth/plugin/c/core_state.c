/* What sounds, kept: the words of the core that differ from how it began.
 *
 *     struct saved, then runs: how many words to pass over (uint32_t), how many follow (uint32_t), these words
 *
 * The core trusts its memory. What is read is put together beside it and looked at there (core_check.c) before an engine goes on
 * from it.
 */
#include <stdlib.h>
#include <string.h>
#include "checksum.h"
#include "core.h"

struct saved {
    char magic[8];
    uint32_t version, checksum; /* CRC-32 of all that follows */
    uint32_t bank, unused;
    double rate_hz;
    char kernels[32];
    uint64_t words; /* of the part that sounds */
    uint64_t size;  /* of the runs, in bytes */
};
struct run {
    uint32_t skip, count;
};

static const char MAGIC[8] = {'J', 'A', 'W', 'A', 'R', 'I', 'S', 'V'};
enum { VERSION = 1, HEAD = sizeof(struct saved) };
/* a run ends where so many words are as they began: what it costs is then spared */
enum { GAP = 2 };

struct jawari_sound {
    jawari_bank *bank;
    const struct bank_rate *rate;
    uint8_t *state; /* all that sounds, as it stands in the core */
};

static uint64_t words_of(const struct bank_rate *r) { return (r->sounding_end - r->sounding) / 8; }

static void describe(const jawari_bank *bank, const struct bank_rate *r, struct saved *saved) {
    memset(saved, 0, sizeof *saved);
    memcpy(saved->magic, MAGIC, sizeof MAGIC);
    saved->version = VERSION;
    saved->bank = bank->checksum;
    saved->rate_hz = r->rate_hz;
    const char *kernels = jawari_kernels_version();
    const size_t length = strlen(kernels);
    memcpy(saved->kernels, kernels, length < sizeof saved->kernels ? length : sizeof saved->kernels);
    saved->words = words_of(r);
}

/* The checksum of what stands behind it. */
static uint32_t checksum(const struct saved *saved, const uint8_t *runs) {
    const size_t from = offsetof(struct saved, bank);
    const uint32_t head = crc32_of(0, (const uint8_t *)saved + from, sizeof *saved - from);
    return crc32_of(head, runs, (size_t)saved->size);
}

/* Word k as it began. */
static int64_t begun(const jawari_engine *engine, uint64_t k) {
    const struct bank_rate *r = engine->rate;
    const uint64_t at = r->sounding + 8 * k;
    int64_t word = 0;
    if (at < r->core_stored)
        memcpy(&word, engine->block + r->core_at + at, r->core_stored - at < 8 ? (size_t)(r->core_stored - at) : 8);
    return word;
}

size_t jawari_most_saved(const jawari_engine *engine) { return HEAD + sizeof(struct run) + 8 * (size_t)words_of(engine->rate); }

int64_t jawari_save(const jawari_engine *engine, void *data, size_t room) {
    struct saved saved;
    describe(engine->bank, engine->rate, &saved);
    if (room < HEAD)
        return -1;
    uint8_t *runs = (uint8_t *)data + HEAD;
    room -= HEAD;
    const int64_t *now = (const void *)(engine->memory + engine->rate->sounding);
    size_t at = 0;
    uint64_t done = 0;
    for (uint64_t k = 0; k < saved.words;) {
        if (now[k] == begun(engine, k)) {
            k++;
            continue;
        }
        uint64_t end = k + 1; /* behind the last word that differs */
        for (uint64_t j = end; j < saved.words && j - end < GAP; j++)
            if (now[j] != begun(engine, j))
                end = j + 1;
        const struct run run = {(uint32_t)(k - done), (uint32_t)(end - k)};
        const size_t size = 8 * (size_t)(end - k);
        if (room - at < sizeof run + size)
            return -1;
        memcpy(runs + at, &run, sizeof run);
        memcpy(runs + at + sizeof run, now + k, size);
        at += sizeof run + size;
        k = done = end;
    }
    saved.size = at;
    saved.checksum = checksum(&saved, runs);
    memcpy(data, &saved, sizeof saved);
    return (int64_t)(HEAD + at);
}

static jawari_sound *refuse(char *why, const char *what) {
    core_say(why, "what sounded cannot be taken up: %s; it goes on from where it was", what);
    return NULL;
}

/* Whether runs are whole, and lead to words that there are. */
static bool whole(const uint8_t *runs, uint64_t size, uint64_t words) {
    for (uint64_t at = 0, word = 0; at < size;) {
        struct run run;
        if (size - at < sizeof run)
            return false;
        memcpy(&run, runs + at, sizeof run);
        word += run.skip;
        at += sizeof run;
        if (word > words || run.count > words - word || run.count > (size - at) / 8)
            return false;
        word += run.count;
        at += 8 * (uint64_t)run.count;
    }
    return true;
}

jawari_sound *jawari_read(jawari_bank *bank, const void *data, size_t size, int32_t *elsewhere, char *why) {
    struct saved saved, mine;
    *elsewhere = 0;
    if (data == NULL || size < HEAD)
        return refuse(why, "it was cut off");
    memcpy(&saved, data, sizeof saved);
    if (memcmp(saved.magic, MAGIC, sizeof MAGIC) != 0)
        return refuse(why, "it is no state of an engine");
    if (saved.version != VERSION) {
        *elsewhere = 1;
        return refuse(why, "it was saved by another version");
    }
    if (saved.size > size - HEAD)
        return refuse(why, "it was cut off");
    const uint8_t *runs = (const uint8_t *)data + HEAD;
    if (saved.checksum != checksum(&saved, runs))
        return refuse(why, "it was changed (its checksum is wrong)");
    const struct bank_rate *r = bank_block(bank, saved.rate_hz, NULL);
    *elsewhere = 1;
    if (r == NULL || !(r->rate_hz == saved.rate_hz))
        return refuse(why, "it comes from a sample rate that is not in here");
    describe(bank, r, &mine);
    if (memcmp(saved.kernels, mine.kernels, sizeof mine.kernels) != 0)
        return refuse(why, "it was saved by another version");
    if (saved.bank != mine.bank || saved.words != mine.words)
        return refuse(why, "it comes from other presets");
    *elsewhere = 0;
    if (!whole(runs, saved.size, saved.words))
        return refuse(why, "it was changed");
    jawari_sound *sound = calloc(1, sizeof *sound);
    if (sound != NULL) {
        sound->bank = jawari_hold(bank);
        sound->rate = r;
        sound->state = malloc(8 * (size_t)saved.words);
    }
    if (sound == NULL || sound->state == NULL) {
        jawari_forget(sound);
        return refuse(why, "there is not enough memory");
    }
    const uint8_t *block = bank->data + r->at;
    core_first(r, block, sound->state);
    for (uint64_t at = 0, word = 0; at < saved.size;) {
        struct run run;
        memcpy(&run, runs + at, sizeof run);
        word += run.skip;
        at += sizeof run;
        memcpy(sound->state + 8 * word, runs + at, 8 * (size_t)run.count);
        word += run.count;
        at += 8 * (uint64_t)run.count;
    }
    char what[JAWARI_WHY];
    if (!core_within_limits(r, block, sound->state, what)) {
        jawari_forget(sound);
        return refuse(why, what);
    }
    return sound;
}

double jawari_saved_rate(const void *data, size_t size) {
    struct saved saved;
    if (data == NULL || size < HEAD)
        return 0.0;
    memcpy(&saved, data, sizeof saved);
    return memcmp(saved.magic, MAGIC, sizeof MAGIC) == 0 ? saved.rate_hz : 0.0;
}

void jawari_forget(jawari_sound *sound) {
    if (sound == NULL)
        return;
    free(sound->state);
    jawari_close(sound->bank);
    free(sound);
}

/* Whether it is of the engine's bank and rate. A bank that was opened twice is still one. */
static bool same(const jawari_sound *sound, const jawari_engine *engine) {
    const struct bank_rate *mine = engine->rate, *theirs = sound->rate;
    return mine == theirs || (sound->bank->checksum == engine->bank->checksum && theirs->rate_hz == mine->rate_hz &&
                              theirs->checksum == mine->checksum && words_of(theirs) == words_of(mine));
}

int32_t jawari_take_up(jawari_engine *engine, const jawari_sound *sound) {
    if (sound == NULL || !same(sound, engine))
        return -1;
    core_fade_out(engine);
    core_begin_anew(engine);
    memcpy(engine->memory + engine->rate->sounding, sound->state, 8 * (size_t)words_of(engine->rate));
    engine->touched = true;
    return 0;
}

int32_t jawari_load(jawari_engine *engine, const void *data, size_t size, char *why) {
    int32_t elsewhere;
    jawari_sound *sound = jawari_read(engine->bank, data, size, &elsewhere, why);
    const int32_t taken = sound == NULL ? -1 : jawari_take_up(engine, sound);
    if (sound != NULL && taken != 0)
        refuse(why, "it comes from another sample rate");
    jawari_forget(sound);
    return taken;
}
