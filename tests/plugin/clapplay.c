/* clapplay PLUGIN RATE FRAMES BLOCK EVENTS OUT: a host for a CLAP, for the systems that plugins are made for.
 *
 * EVENTS is a text, a line for each event: its frame, "on" or "off", channel, key, velocity from 0 to 1. OUT gets FRAMES frames
 * of two channels, as float, interleaved. Says what went wrong, with exit code 1; silence is not wrong. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "clap_api.h"

#if defined(_WIN32)
#include <windows.h>
static void *opened(const char *path) { return (void *)LoadLibraryA(path); }
static void *found(void *library, const char *name) { return (void *)GetProcAddress((HMODULE)library, name); }
static const char *wrong(void) { return "Windows cannot load it"; }
#else
#include <dlfcn.h>
static void *opened(const char *path) { return dlopen(path, RTLD_NOW | RTLD_LOCAL); }
static void *found(void *library, const char *name) { return dlsym(library, name); }
static const char *wrong(void) { return dlerror(); }
#endif

enum { MOST_EVENTS = 4096 };

static clap_event_note_t events[MOST_EVENTS];
static uint32_t all, first, within; /* of them; the first of the block, and how many it has */

static uint32_t count(const clap_input_events_t *list) {
    (void)list;
    return within;
}
static const clap_event_header_t *get(const clap_input_events_t *list, uint32_t k) {
    (void)list;
    return k < within ? &events[first + k].header : NULL;
}
static bool take(const clap_output_events_t *list, const clap_event_header_t *event) {
    (void)list, (void)event;
    return true;
}

static const void *no_extension(const clap_host_t *host, const char *id) {
    (void)host, (void)id;
    return NULL;
}
static void nothing(const clap_host_t *host) { (void)host; }

static int fail(const char *what, const char *why) {
    fprintf(stderr, "clapplay: %s: %s\n", what, why);
    return 1;
}

static int read_events(const char *path) {
    FILE *file = fopen(path, "r");
    char word[4];
    unsigned frame;
    int channel, key;
    double velocity;
    if (file == NULL)
        return fail(path, "cannot be read");
    while (all < MOST_EVENTS && fscanf(file, "%u %3s %d %d %lf", &frame, word, &channel, &key, &velocity) == 5)
        events[all++] = (clap_event_note_t){
            .header = {sizeof *events, frame, CLAP_CORE_EVENT_SPACE_ID,
                       strcmp(word, "on") == 0 ? CLAP_EVENT_NOTE_ON : CLAP_EVENT_NOTE_OFF, 0},
            .note_id = -1, .channel = (int16_t)channel, .key = (int16_t)key, .velocity = velocity};
    fclose(file);
    return 0;
}

/* All frames, block after block. */
static int play(const clap_plugin_t *plugin, uint32_t frames, uint32_t block, FILE *out) {
    float *left = calloc(block, sizeof *left), *right = calloc(block, sizeof *right);
    float *both[2] = {left, right};
    clap_audio_buffer_t sound = {.data32 = both, .channel_count = 2};
    const clap_input_events_t in = {.size = count, .get = get};
    const clap_output_events_t told = {.try_push = take};
    if (left == NULL || right == NULL)
        return fail("a block", "there is no memory for it");
    for (uint32_t done = 0, n; done < frames; done += n, first += within) {
        n = frames - done < block ? frames - done : block;
        for (within = 0; first + within < all && events[first + within].header.time < done + n; within++)
            events[first + within].header.time -= done;
        const clap_process_t process = {.steady_time = done, .frames_count = n, .audio_outputs = &sound, .audio_outputs_count = 1,
                                        .in_events = &in, .out_events = &told};
        if (plugin->process(plugin, &process) == CLAP_PROCESS_ERROR)
            return fail("a block", "the plugin refuses it");
        for (uint32_t i = 0; i < n; i++)
            for (int side = 0; side < 2; side++)
                fwrite(&both[side][i], sizeof **both, 1, out);
    }
    free(left);
    free(right);
    return 0;
}

int main(int given, char **argument) {
    if (given != 7)
        return fail("usage", "clapplay PLUGIN RATE FRAMES BLOCK EVENTS OUT");
    const double rate = atof(argument[2]);
    const uint32_t frames = (uint32_t)atoi(argument[3]), block = (uint32_t)atoi(argument[4]);
    static const clap_host_t host = {.clap_version = CLAP_VERSION_INIT, .name = "clapplay", .vendor = "", .url = "", .version = "1",
                                     .get_extension = no_extension, .request_restart = nothing, .request_process = nothing,
                                     .request_callback = nothing};
    if (block == 0 || read_events(argument[5]) != 0)
        return 1;
    void *library = opened(argument[1]);
    if (library == NULL)
        return fail(argument[1], wrong());
    const clap_plugin_entry_t *entry = found(library, "clap_entry");
    if (entry == NULL || !entry->init(argument[1]))
        return fail(argument[1], "it is no plugin that can be used");
    const clap_plugin_factory_t *factory = entry->get_factory(CLAP_PLUGIN_FACTORY_ID);
    const clap_plugin_descriptor_t *about = factory ? factory->get_plugin_descriptor(factory, 0) : NULL;
    const clap_plugin_t *plugin = about ? factory->create_plugin(factory, &host, about->id) : NULL;
    if (plugin == NULL || !plugin->init(plugin))
        return fail(argument[1], "no instance can be made");
    if (!plugin->activate(plugin, rate, 1, block) || !plugin->start_processing(plugin))
        return fail(argument[1], "it does not play at this rate");
    FILE *out = fopen(argument[6], "wb");
    if (out == NULL)
        return fail(argument[6], "cannot be written");
    int result = play(plugin, frames, block, out);
    if (fclose(out) != 0)
        result = fail(argument[6], "cannot be written");
    plugin->stop_processing(plugin);
    plugin->deactivate(plugin);
    plugin->destroy(plugin);
    entry->deinit();
    printf("%s %s\n", about->id, about->version);
    return result;
}
