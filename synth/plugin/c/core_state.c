/* What sounds, kept: the words of the core that differ from how it began.
 *
 *     struct saved, then runs: how many words to pass over (uint32_t), how many follow (uint32_t), these words
 */
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

static uint64_t words_of(const jawari_engine *engine) { return (engine->rate->sounding_end - engine->rate->sounding) / 8; }

static void describe(const jawari_engine *engine, struct saved *saved) {
    memset(saved, 0, sizeof *saved);
    memcpy(saved->magic, MAGIC, sizeof MAGIC);
    saved->version = VERSION;
    saved->bank = engine->bank->checksum;
    saved->rate_hz = engine->rate->rate_hz;
    const char *kernels = jawari_kernels_version();
    const size_t length = strlen(kernels);
    memcpy(saved->kernels, kernels, length < sizeof saved->kernels ? length : sizeof saved->kernels);
    saved->words = words_of(engine);
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

size_t jawari_most_saved(const jawari_engine *engine) { return HEAD + sizeof(struct run) + 8 * (size_t)words_of(engine); }

int64_t jawari_save(const jawari_engine *engine, void *data, size_t room) {
    struct saved saved;
    describe(engine, &saved);
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

static int32_t refuse(char *why, const char *what) {
    core_say(why, "what sounded cannot be taken up: %s; it goes on from where it was", what);
    return -1;
}

int32_t jawari_load(jawari_engine *engine, const void *data, size_t size, char *why) {
    struct saved saved, mine;
    if (data == NULL || size < HEAD)
        return refuse(why, "it was cut off");
    memcpy(&saved, data, sizeof saved);
    describe(engine, &mine);
    if (memcmp(saved.magic, mine.magic, sizeof mine.magic) != 0)
        return refuse(why, "it is no state of an engine");
    if (saved.version != mine.version || memcmp(saved.kernels, mine.kernels, sizeof mine.kernels) != 0)
        return refuse(why, "it was saved by another version");
    if (saved.size > size - HEAD)
        return refuse(why, "it was cut off");
    const uint8_t *runs = (const uint8_t *)data + HEAD;
    if (saved.checksum != checksum(&saved, runs))
        return refuse(why, "it was changed (its checksum is wrong)");
    if (saved.bank != mine.bank || saved.words != mine.words)
        return refuse(why, "it comes from other presets");
    if (!(saved.rate_hz == mine.rate_hz))
        return refuse(why, "it comes from another sample rate");
    /* first all is looked at: an engine that refuses goes on from where it was */
    uint64_t at = 0, word = 0;
    while (at < saved.size) {
        struct run run;
        if (saved.size - at < sizeof run)
            return refuse(why, "it was changed");
        memcpy(&run, runs + at, sizeof run);
        word += run.skip;
        at += sizeof run;
        if (word > saved.words || run.count > saved.words - word || run.count > (saved.size - at) / 8)
            return refuse(why, "it was changed");
        word += run.count;
        at += 8 * (uint64_t)run.count;
    }
    core_begin_anew(engine);
    uint8_t *sounding = engine->memory + engine->rate->sounding;
    for (at = 0, word = 0; at < saved.size;) {
        struct run run;
        memcpy(&run, runs + at, sizeof run);
        word += run.skip;
        at += sizeof run;
        memcpy(sounding + 8 * word, runs + at, 8 * (size_t)run.count);
        word += run.count;
        at += 8 * (uint64_t)run.count;
    }
    engine->touched = true;
    return 0;
}
