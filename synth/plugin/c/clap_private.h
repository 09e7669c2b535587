/* clap_private.h: an instance as a CLAP host sees it, for the files clap*.c. */
#ifndef JAWARI_CLAP_PRIVATE_H
#define JAWARI_CLAP_PRIVATE_H

#include <stdatomic.h>

#include "clap_api.h"
#include "plugin.h"

enum { CLAP_CHANNELS = 16, CLAP_KEYS = 128 };

/* A note that the host began by an event of its own, and that it will be told the end of. */
typedef struct clap_note {
    int32_t id;    /* −1: the host has given none */
    int32_t age;   /* [frames] */
    bool open;     /* its end has not been told */
    bool released;
} clap_note;

/* A string plays one note, so of one key on one channel there is one at a time. */
typedef struct clap_notes {
    clap_note of[CLAP_CHANNELS][CLAP_KEYS];
    int32_t open;
} clap_notes;

typedef struct clap_instance {
    clap_plugin_t clap;
    const clap_host_t *host;
    const clap_host_latency_t *host_latency;
    const clap_host_params_t *host_params;
    const clap_host_thread_pool_t *host_pool;
    const clap_host_log_t *host_log;
    plugin *p;
    int32_t told_latency; /* that the host was told last, −1: none */
    bool lent; /* threads of the host's compute */
    atomic_bool loaded; /* values have come from a state: the host knows them */

    /* audio thread */
    double *told; /* values that the host knows */
    clap_notes notes;
    uint32_t last_time; /* of the last event that the host was given in this block */
    int32_t frames;     /* the block, for the threads of the host */
    float *narrow[2];
    double *wide[2];
    bool is_wide;
} clap_instance;

/* Extensions by their id, NULL. */
const void *clap_extension(const char *id);

/* Logs what there is to be said of the setup. */
void clap_remark(const clap_instance *m);

/* One event of a block, or of a flush: then only values are taken. */
void clap_hear(clap_instance *m, const clap_event_header_t *event, const clap_output_events_t *out);
void clap_flush(clap_instance *m, const clap_input_events_t *in, const clap_output_events_t *out);
/* After a block of so many frames: what the host is to be told. */
void clap_tell(clap_instance *m, uint32_t frames, const clap_output_events_t *out);
/* The host's transport at a frame; NULL: it has none. */
void clap_transport(clap_instance *m, uint32_t time, const clap_event_transport_t *transport);
void clap_forget_notes(clap_instance *m);
/* The block that is at hand. */
void clap_compute(clap_instance *m);

#endif
