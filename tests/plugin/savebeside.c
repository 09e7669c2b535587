/* savebeside: who makes the copy of what sounds that plugin_save gives, the thread that asks for it or the audio thread.
 *
 * The plugin's own sources on an engine that stands in for the real one: what it saves says which thread did. Prints "saving" for
 * the thread that asked, "audio" for the other: first while no block is computed, then while blocks follow each other and one has
 * begun whenever the asking thread has made a copy. */
#define _GNU_SOURCE
#include <pthread.h>
#include <sched.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "drone_score.h"
#include "plugin.h"

static pthread_t audio;
static atomic_bool playing, ending;
static atomic_long blocks;

struct jawari_bank {
    int nothing;
};
struct jawari_engine {
    int nothing;
};
static jawari_bank the_bank;
static jawari_engine the_engine;
static const char MADE_BY[] = "made by ";

int64_t jawari_save(const jawari_engine *engine, void *data, size_t room) {
    (void)engine;
    const bool mine = atomic_load(&playing) && pthread_equal(pthread_self(), audio);
    if (!mine && atomic_load(&playing)) /* the copy is of no use: a block has begun since */
        for (long before = atomic_load(&blocks); atomic_load(&blocks) < before + 2;)
            sched_yield();
    return snprintf(data, room, "%s%s", MADE_BY, mine ? "audio" : "saving");
}

size_t jawari_most_saved(const jawari_engine *engine) { return engine ? 64 : 0; }

void jawari_process(jawari_engine *engine, const jawari_event *events, int32_t count, int32_t frames, double *left, double *right) {
    (void)engine, (void)events, (void)count;
    memset(left, 0, (size_t)frames * sizeof *left);
    memset(right, 0, (size_t)frames * sizeof *right);
    atomic_fetch_add(&blocks, 1);
}

void jawari_process_float(jawari_engine *engine, const jawari_event *events, int32_t count, int32_t frames, float *left,
                          float *right) {
    (void)engine, (void)events, (void)count, (void)frames, (void)left, (void)right;
}

jawari_bank *jawari_open_own(char *why) { return why ? &the_bank : NULL; }
const char *bank_own_file(void);
const char *bank_own_file(void) { return NULL; }
jawari_bank *jawari_open(const char *path, char *why) { return (void)path, (void)why, NULL; }
jawari_bank *jawari_hold(jawari_bank *bank) { return bank; }
void jawari_close(jawari_bank *bank) { (void)bank; }
int32_t jawari_presets(const jawari_bank *bank) { return bank != NULL; }
const jawari_preset *jawari_preset_of(const jawari_bank *bank, int32_t k) { return (void)bank, (void)k, NULL; }
int32_t jawari_parameters(const jawari_bank *bank) { return (void)bank, 0; }
const jawari_parameter *jawari_parameter_of(const jawari_bank *bank, int32_t k) { return (void)bank, (void)k, NULL; }
int32_t jawari_setup_numbers(const jawari_bank *bank) { return (void)bank, 0; }
const jawari_parameter *jawari_setup_number_of(const jawari_bank *bank, int32_t k) { return (void)bank, (void)k, NULL; }
int32_t jawari_strings(const jawari_bank *bank) { return (void)bank, 1; }
const uint8_t *jawari_bank_uid(const jawari_bank *bank) { return (const uint8_t *)bank; }
uint32_t jawari_bank_checksum(const jawari_bank *bank) { return (void)bank, 0; }
const struct drone_score *bank_drone(const jawari_bank *bank) { return (void)bank, NULL; }
const char *jawari_kernels_version(void) { return "none"; }
const char *jawari_bank_id(const jawari_bank *bank) { return bank ? "nothing" : ""; }
double jawari_rate_of(const jawari_bank *bank, int32_t k) { return (void)bank, (void)k, 48000.0; }
jawari_engine *jawari_create(jawari_bank *bank, double rate_hz, int32_t threads, char *why) {
    return (void)bank, (void)rate_hz, (void)threads, (void)why, &the_engine;
}
void jawari_destroy(jawari_engine *engine) { (void)engine; }
void jawari_lend(jawari_engine *engine) { (void)engine; }
void jawari_help(jawari_engine *engine, int32_t k) { (void)engine, (void)k; }
int32_t jawari_threads(const jawari_engine *engine) { return engine != NULL; }
int32_t jawari_latency(const jawari_engine *engine) { return (void)engine, 0; }
int64_t jawari_tail(const jawari_engine *engine) { return (void)engine, 0; }
int32_t jawari_midi(const uint8_t *bytes, size_t size, int64_t frame, jawari_event *events, int32_t room) {
    return (void)bytes, (void)size, (void)frame, (void)events, (void)room, 0;
}
void jawari_reset(jawari_engine *engine) { (void)engine; }
int32_t jawari_silent(const jawari_engine *engine) { return engine != NULL; }
int32_t jawari_voices(const jawari_engine *engine) { return (void)engine, 0; }
int32_t jawari_sounding(const jawari_engine *engine, int32_t channel, int32_t note) {
    return (void)engine, (void)channel, (void)note, 0;
}
double jawari_pitch(const jawari_engine *engine, int32_t key) { return (void)engine, key; }
void jawari_report_of(const jawari_engine *engine, jawari_report *report) {
    (void)engine;
    memset(report, 0, sizeof *report);
}
jawari_sound *jawari_read(jawari_bank *bank, const void *data, size_t size, int32_t *elsewhere, char *why) {
    return (void)bank, (void)data, (void)size, (void)elsewhere, (void)why, NULL;
}
double jawari_saved_rate(const void *data, size_t size) { return (void)data, (void)size, 0.0; }
int32_t jawari_waiting(const jawari_engine *engine) { return engine == NULL; }
void jawari_follow(jawari_engine *engine, const jawari_engine *from) { (void)engine, (void)from; }
void jawari_forget(jawari_sound *sound) { (void)sound; }
int32_t jawari_take_up(jawari_engine *engine, const jawari_sound *sound) { return (void)engine, (void)sound, -1; }

static void *play(void *given) {
    double left[32], right[32];
    while (!atomic_load(&ending))
        plugin_process(given, 32, NULL, (double *const[2]){left, right});
    return NULL;
}

/* Who made the copy that is in a state. */
static bool tell(plugin *p) {
    size_t size;
    char *data = plugin_save(p, &size);
    const char *found = data ? memmem(data, size, MADE_BY, strlen(MADE_BY)) : NULL;
    if (found)
        puts(found[strlen(MADE_BY)] == 'a' ? "audio" : "saving");
    free(data);
    return found != NULL;
}

int main(void) {
    char why[JAWARI_WHY];
    plugin *p = plugin_new(why);
    if (!p || !plugin_activate(p, 48000.0, 1, false, why))
        return 1;
    bool told = tell(p);
    if (pthread_create(&audio, NULL, play, p) != 0)
        return 1;
    while (atomic_load(&blocks) < 10)
        sched_yield();
    atomic_store(&playing, true);
    told = tell(p) && told;
    atomic_store(&ending, true);
    pthread_join(audio, NULL);
    plugin_free(p);
    return told ? 0 : 2;
}
