/* clap_api.h: the parts of CLAP 1.2 (CLever Audio Plug-in interface) that this plugin speaks, by its specification: names, numbers
 * and the order of fields are those that hosts are compiled with, and so may not change.
 */
#ifndef JAWARI_CLAP_API_H
#define JAWARI_CLAP_API_H

#include <stdbool.h>
#include <stdint.h>

typedef uint32_t clap_id;
#define CLAP_INVALID_ID UINT32_MAX
enum { CLAP_NAME_SIZE = 256, CLAP_PATH_SIZE = 1024 };

typedef struct clap_version {
    uint32_t major, minor, revision;
} clap_version_t;
#define CLAP_VERSION_INIT {1, 2, 2}

/* ---- events: each begins with the header, whose size counts all of it ---- */

typedef struct clap_event_header {
    uint32_t size;
    uint32_t time; /* frames from the start of the block */
    uint16_t space_id;
    uint16_t type;
    uint32_t flags;
} clap_event_header_t;

enum { CLAP_CORE_EVENT_SPACE_ID = 0 };
enum {
    CLAP_EVENT_NOTE_ON = 0,
    CLAP_EVENT_NOTE_OFF = 1,
    CLAP_EVENT_NOTE_CHOKE = 2,
    CLAP_EVENT_NOTE_END = 3,
    CLAP_EVENT_NOTE_EXPRESSION = 4,
    CLAP_EVENT_PARAM_VALUE = 5,
    CLAP_EVENT_TRANSPORT = 9,
    CLAP_EVENT_MIDI = 10,
    CLAP_EVENT_MIDI_SYSEX = 11
};

/* Whom an event concerns: −1 stands for all. */
typedef struct clap_event_note {
    clap_event_header_t header;
    int32_t note_id;
    int16_t port_index, channel, key;
    double velocity; /* 0 … 1 */
} clap_event_note_t;

enum { CLAP_NOTE_EXPRESSION_TUNING = 2, CLAP_NOTE_EXPRESSION_BRIGHTNESS = 5, CLAP_NOTE_EXPRESSION_PRESSURE = 6 };

typedef struct clap_event_note_expression {
    clap_event_header_t header;
    int32_t expression_id;
    int32_t note_id;
    int16_t port_index, channel, key;
    double value;
} clap_event_note_expression_t;

typedef struct clap_event_param_value {
    clap_event_header_t header;
    clap_id param_id;
    void *cookie;
    int32_t note_id;
    int16_t port_index, channel, key;
    double value;
} clap_event_param_value_t;

enum { /* clap_event_transport.flags */
    CLAP_TRANSPORT_HAS_TEMPO = 1 << 0,
    CLAP_TRANSPORT_HAS_BEATS_TIMELINE = 1 << 1,
    CLAP_TRANSPORT_IS_PLAYING = 1 << 4
};
#define CLAP_BEATTIME_FACTOR ((int64_t)1 << 31)

typedef struct clap_event_transport {
    clap_event_header_t header;
    uint32_t flags;
    int64_t song_pos_beats; /* in units of 1 / CLAP_BEATTIME_FACTOR */
    int64_t song_pos_seconds;
    double tempo; /* beats a minute */
    double tempo_inc;
    int64_t loop_start_beats, loop_end_beats;
    int64_t loop_start_seconds, loop_end_seconds;
    int64_t bar_start;
    int32_t bar_number;
    uint16_t tsig_num, tsig_denom;
} clap_event_transport_t;

typedef struct clap_event_midi {
    clap_event_header_t header;
    uint16_t port_index;
    uint8_t data[3];
} clap_event_midi_t;

typedef struct clap_event_midi_sysex {
    clap_event_header_t header;
    uint16_t port_index;
    const uint8_t *buffer; /* the host's, as long as the block lasts */
    uint32_t size;
} clap_event_midi_sysex_t;

typedef struct clap_input_events {
    void *ctx;
    uint32_t (*size)(const struct clap_input_events *list);
    const clap_event_header_t *(*get)(const struct clap_input_events *list, uint32_t index);
} clap_input_events_t;

typedef struct clap_output_events {
    void *ctx;
    bool (*try_push)(const struct clap_output_events *list, const clap_event_header_t *event);
} clap_output_events_t;

/* ---- blocks ---- */

typedef struct clap_audio_buffer {
    float **data32; /* one of the two is NULL */
    double **data64;
    uint32_t channel_count;
    uint32_t latency;
    uint64_t constant_mask;
} clap_audio_buffer_t;

typedef int32_t clap_process_status;
enum { CLAP_PROCESS_ERROR = 0, CLAP_PROCESS_CONTINUE = 1, CLAP_PROCESS_SLEEP = 4 };

typedef struct clap_process {
    int64_t steady_time;
    uint32_t frames_count;
    const struct clap_event_transport *transport; /* NULL: the host has none */
    const clap_audio_buffer_t *audio_inputs;
    clap_audio_buffer_t *audio_outputs;
    uint32_t audio_inputs_count, audio_outputs_count;
    const clap_input_events_t *in_events;
    const clap_output_events_t *out_events;
} clap_process_t;

/* ---- host, plugin, factory, entry ---- */

typedef struct clap_host {
    clap_version_t clap_version;
    void *host_data;
    const char *name, *vendor, *url, *version;
    const void *(*get_extension)(const struct clap_host *host, const char *id);
    void (*request_restart)(const struct clap_host *host);
    void (*request_process)(const struct clap_host *host);
    void (*request_callback)(const struct clap_host *host);
} clap_host_t;

typedef struct clap_plugin_descriptor {
    clap_version_t clap_version;
    const char *id, *name, *vendor, *url, *manual_url, *support_url, *version, *description;
    const char *const *features; /* ends with NULL */
} clap_plugin_descriptor_t;

typedef struct clap_plugin {
    const clap_plugin_descriptor_t *desc;
    void *plugin_data;
    bool (*init)(const struct clap_plugin *plugin);
    void (*destroy)(const struct clap_plugin *plugin);
    bool (*activate)(const struct clap_plugin *plugin, double sample_rate, uint32_t min_frames, uint32_t max_frames);
    void (*deactivate)(const struct clap_plugin *plugin);
    bool (*start_processing)(const struct clap_plugin *plugin);
    void (*stop_processing)(const struct clap_plugin *plugin);
    void (*reset)(const struct clap_plugin *plugin);
    clap_process_status (*process)(const struct clap_plugin *plugin, const clap_process_t *process);
    const void *(*get_extension)(const struct clap_plugin *plugin, const char *id);
    void (*on_main_thread)(const struct clap_plugin *plugin);
} clap_plugin_t;

#define CLAP_PLUGIN_FACTORY_ID "clap.plugin-factory"
typedef struct clap_plugin_factory {
    uint32_t (*get_plugin_count)(const struct clap_plugin_factory *factory);
    const clap_plugin_descriptor_t *(*get_plugin_descriptor)(const struct clap_plugin_factory *factory, uint32_t index);
    const clap_plugin_t *(*create_plugin)(const struct clap_plugin_factory *factory, const clap_host_t *host, const char *id);
} clap_plugin_factory_t;

typedef struct clap_plugin_entry {
    clap_version_t clap_version;
    bool (*init)(const char *plugin_path);
    void (*deinit)(void);
    const void *(*get_factory)(const char *factory_id);
} clap_plugin_entry_t;

/* ---- extensions ---- */

#define CLAP_EXT_AUDIO_PORTS "clap.audio-ports"
#define CLAP_PORT_STEREO "stereo"
enum { CLAP_AUDIO_PORT_IS_MAIN = 1, CLAP_AUDIO_PORT_SUPPORTS_64BITS = 2 };
typedef struct clap_audio_port_info {
    clap_id id;
    char name[CLAP_NAME_SIZE];
    uint32_t flags;
    uint32_t channel_count;
    const char *port_type;
    clap_id in_place_pair;
} clap_audio_port_info_t;
typedef struct clap_plugin_audio_ports {
    uint32_t (*count)(const clap_plugin_t *plugin, bool is_input);
    bool (*get)(const clap_plugin_t *plugin, uint32_t index, bool is_input, clap_audio_port_info_t *info);
} clap_plugin_audio_ports_t;

#define CLAP_EXT_NOTE_PORTS "clap.note-ports"
enum { CLAP_NOTE_DIALECT_CLAP = 1, CLAP_NOTE_DIALECT_MIDI = 2, CLAP_NOTE_DIALECT_MIDI_MPE = 4 };
typedef struct clap_note_port_info {
    clap_id id;
    uint32_t supported_dialects;
    uint32_t preferred_dialect;
    char name[CLAP_NAME_SIZE];
} clap_note_port_info_t;
typedef struct clap_plugin_note_ports {
    uint32_t (*count)(const clap_plugin_t *plugin, bool is_input);
    bool (*get)(const clap_plugin_t *plugin, uint32_t index, bool is_input, clap_note_port_info_t *info);
} clap_plugin_note_ports_t;

#define CLAP_EXT_PARAMS "clap.params"
enum {
    CLAP_PARAM_IS_STEPPED = 1 << 0,
    CLAP_PARAM_IS_READONLY = 1 << 3,
    CLAP_PARAM_IS_BYPASS = 1 << 4,
    CLAP_PARAM_IS_AUTOMATABLE = 1 << 5,
    CLAP_PARAM_IS_ENUM = 1 << 16
};
enum { CLAP_PARAM_RESCAN_VALUES = 1, CLAP_PARAM_RESCAN_TEXT = 2 };
typedef struct clap_param_info {
    clap_id id;
    uint32_t flags;
    void *cookie;
    char name[CLAP_NAME_SIZE];
    char module[CLAP_PATH_SIZE];
    double min_value, max_value, default_value;
} clap_param_info_t;
typedef struct clap_plugin_params {
    uint32_t (*count)(const clap_plugin_t *plugin);
    bool (*get_info)(const clap_plugin_t *plugin, uint32_t index, clap_param_info_t *info);
    bool (*get_value)(const clap_plugin_t *plugin, clap_id id, double *value);
    bool (*value_to_text)(const clap_plugin_t *plugin, clap_id id, double value, char *text, uint32_t room);
    bool (*text_to_value)(const clap_plugin_t *plugin, clap_id id, const char *text, double *value);
    void (*flush)(const clap_plugin_t *plugin, const clap_input_events_t *in, const clap_output_events_t *out);
} clap_plugin_params_t;
typedef struct clap_host_params {
    void (*rescan)(const clap_host_t *host, uint32_t flags);
    void (*clear)(const clap_host_t *host, clap_id id, uint32_t flags);
    void (*request_flush)(const clap_host_t *host);
} clap_host_params_t;

#define CLAP_EXT_STATE "clap.state"
typedef struct clap_istream {
    void *ctx;
    int64_t (*read)(const struct clap_istream *stream, void *buffer, uint64_t size); /* 0: the end, −1: it failed */
} clap_istream_t;
typedef struct clap_ostream {
    void *ctx;
    int64_t (*write)(const struct clap_ostream *stream, const void *buffer, uint64_t size);
} clap_ostream_t;
typedef struct clap_plugin_state {
    bool (*save)(const clap_plugin_t *plugin, const clap_ostream_t *stream);
    bool (*load)(const clap_plugin_t *plugin, const clap_istream_t *stream);
} clap_plugin_state_t;

#define CLAP_EXT_LATENCY "clap.latency"
typedef struct clap_plugin_latency {
    uint32_t (*get)(const clap_plugin_t *plugin);
} clap_plugin_latency_t;
typedef struct clap_host_latency {
    void (*changed)(const clap_host_t *host);
} clap_host_latency_t;

#define CLAP_EXT_TAIL "clap.tail"
typedef struct clap_plugin_tail {
    uint32_t (*get)(const clap_plugin_t *plugin); /* INT32_MAX and more: without end */
} clap_plugin_tail_t;

#define CLAP_EXT_RENDER "clap.render"
typedef struct clap_plugin_render {
    bool (*has_hard_realtime_requirement)(const clap_plugin_t *plugin);
    bool (*set)(const clap_plugin_t *plugin, int32_t mode);
} clap_plugin_render_t;

#define CLAP_EXT_VOICE_INFO "clap.voice-info"
typedef struct clap_voice_info {
    uint32_t voice_count;    /* that can sound now */
    uint32_t voice_capacity; /* that could ever */
    uint64_t flags;
} clap_voice_info_t;
typedef struct clap_plugin_voice_info {
    bool (*get)(const clap_plugin_t *plugin, clap_voice_info_t *info);
} clap_plugin_voice_info_t;

#define CLAP_EXT_THREAD_POOL "clap.thread-pool"
typedef struct clap_plugin_thread_pool {
    void (*exec)(const clap_plugin_t *plugin, uint32_t task_index);
} clap_plugin_thread_pool_t;
typedef struct clap_host_thread_pool {
    bool (*request_exec)(const clap_host_t *host, uint32_t num_tasks); /* back when all are done; false: none was begun */
} clap_host_thread_pool_t;

#define CLAP_EXT_REMOTE_CONTROLS "clap.remote-controls/2"
#define CLAP_EXT_REMOTE_CONTROLS_COMPAT "clap.remote-controls.draft/2"
enum { CLAP_REMOTE_CONTROLS_COUNT = 8 };
typedef struct clap_remote_controls_page {
    char section_name[CLAP_NAME_SIZE];
    clap_id page_id;
    char page_name[CLAP_NAME_SIZE];
    clap_id param_ids[CLAP_REMOTE_CONTROLS_COUNT];
    bool is_for_preset;
} clap_remote_controls_page_t;
typedef struct clap_plugin_remote_controls {
    uint32_t (*count)(const clap_plugin_t *plugin);
    bool (*get)(const clap_plugin_t *plugin, uint32_t page_index, clap_remote_controls_page_t *page);
} clap_plugin_remote_controls_t;

#define CLAP_EXT_LOG "clap.log"
enum { CLAP_LOG_WARNING = 2, CLAP_LOG_ERROR = 3 };
typedef struct clap_host_log {
    void (*log)(const clap_host_t *host, int32_t severity, const char *text);
} clap_host_log_t;

#endif
