/* lv2_api.h: what this plugin uses of LV2, declared from its specification (lv2plug.in): core, URID, atom sequences of MIDI, state, log.
 * Names and layouts are those of the specification. */
#ifndef JAWARI_LV2_API_H
#define JAWARI_LV2_API_H

#include <stdint.h>

/* ---- core ---- */

typedef void *LV2_Handle;

typedef struct LV2_Feature {
    const char *URI;
    void *data;
} LV2_Feature;

typedef struct LV2_Descriptor {
    const char *URI;
    LV2_Handle (*instantiate)(const struct LV2_Descriptor *descriptor, double sample_rate, const char *bundle_path,
                              const LV2_Feature *const *features);
    void (*connect_port)(LV2_Handle instance, uint32_t port, void *data_location);
    void (*activate)(LV2_Handle instance);
    void (*run)(LV2_Handle instance, uint32_t sample_count);
    void (*deactivate)(LV2_Handle instance);
    void (*cleanup)(LV2_Handle instance);
    const void *(*extension_data)(const char *uri);
} LV2_Descriptor;

/* ---- numbers for URIs ---- */

#define LV2_URID__map "http://lv2plug.in/ns/ext/urid#map"

typedef uint32_t LV2_URID;

typedef struct LV2_URID_Map {
    void *handle;
    LV2_URID (*map)(void *handle, const char *uri);
} LV2_URID_Map;

/* ---- atoms: a sequence of events ---- */

#define LV2_ATOM__Chunk "http://lv2plug.in/ns/ext/atom#Chunk"
#define LV2_ATOM__Sequence "http://lv2plug.in/ns/ext/atom#Sequence"
#define LV2_MIDI__MidiEvent "http://lv2plug.in/ns/ext/midi#MidiEvent"

typedef struct LV2_Atom {
    uint32_t size; /* of what follows */
    LV2_URID type;
} LV2_Atom;

typedef struct LV2_Atom_Event {
    int64_t frames; /* of a sequence whose unit is frames */
    LV2_Atom body;
} LV2_Atom_Event;

typedef struct LV2_Atom_Sequence {
    LV2_Atom atom;
    LV2_URID unit; /* 0: frames */
    uint32_t pad;
} LV2_Atom_Sequence;

/* ---- objects, and the host's time as one ---- */

#define LV2_ATOM__Object "http://lv2plug.in/ns/ext/atom#Object"
#define LV2_ATOM__Blank "http://lv2plug.in/ns/ext/atom#Blank" /* as older hosts call it */
#define LV2_ATOM__Float "http://lv2plug.in/ns/ext/atom#Float"
#define LV2_ATOM__Double "http://lv2plug.in/ns/ext/atom#Double"
#define LV2_ATOM__Int "http://lv2plug.in/ns/ext/atom#Int"
#define LV2_ATOM__Long "http://lv2plug.in/ns/ext/atom#Long"
#define LV2_TIME__Position "http://lv2plug.in/ns/ext/time#Position"
#define LV2_TIME__bar "http://lv2plug.in/ns/ext/time#bar"
#define LV2_TIME__barBeat "http://lv2plug.in/ns/ext/time#barBeat"
#define LV2_TIME__beat "http://lv2plug.in/ns/ext/time#beat"
#define LV2_TIME__beatUnit "http://lv2plug.in/ns/ext/time#beatUnit"
#define LV2_TIME__beatsPerBar "http://lv2plug.in/ns/ext/time#beatsPerBar"
#define LV2_TIME__beatsPerMinute "http://lv2plug.in/ns/ext/time#beatsPerMinute"
#define LV2_TIME__speed "http://lv2plug.in/ns/ext/time#speed"

typedef struct LV2_Atom_Object {
    LV2_Atom atom;
    uint32_t id;
    LV2_URID otype;
} LV2_Atom_Object;

typedef struct LV2_Atom_Property {
    LV2_URID key;
    uint32_t context;
    LV2_Atom value; /* what it holds follows, filled up to a multiple of eight bytes */
} LV2_Atom_Property;

/* ---- state ---- */

#define LV2_STATE__interface "http://lv2plug.in/ns/ext/state#interface"

typedef enum { LV2_STATE_IS_POD = 1, LV2_STATE_IS_PORTABLE = 2, LV2_STATE_IS_NATIVE = 4 } LV2_State_Flags;

typedef enum {
    LV2_STATE_SUCCESS = 0,
    LV2_STATE_ERR_UNKNOWN = 1,
    LV2_STATE_ERR_BAD_TYPE = 2,
    LV2_STATE_ERR_BAD_FLAGS = 3,
    LV2_STATE_ERR_NO_FEATURE = 4,
    LV2_STATE_ERR_NO_PROPERTY = 5,
    LV2_STATE_ERR_NO_SPACE = 6
} LV2_State_Status;

typedef LV2_State_Status (*LV2_State_Store_Function)(void *handle, LV2_URID key, const void *value, size_t size, LV2_URID type,
                                                     uint32_t flags);
typedef const void *(*LV2_State_Retrieve_Function)(void *handle, LV2_URID key, size_t *size, LV2_URID *type, uint32_t *flags);

typedef struct LV2_State_Interface {
    LV2_State_Status (*save)(LV2_Handle instance, LV2_State_Store_Function store, void *handle, uint32_t flags,
                             const LV2_Feature *const *features);
    LV2_State_Status (*restore)(LV2_Handle instance, LV2_State_Retrieve_Function retrieve, void *handle, uint32_t flags,
                                const LV2_Feature *const *features);
} LV2_State_Interface;

/* ---- log ---- */

#define LV2_LOG__log "http://lv2plug.in/ns/ext/log#log"
#define LV2_LOG__Error "http://lv2plug.in/ns/ext/log#Error"

typedef struct LV2_Log_Log {
    void *handle;
    int (*printf)(void *handle, LV2_URID type, const char *format, ...);
    int (*vprintf)(void *handle, LV2_URID type, const char *format, __builtin_va_list arguments);
} LV2_Log_Log;

#endif
