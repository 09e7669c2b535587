/* plugin_rebuild.h: the setup of a plugin's presets, which is compiled in, changed where Python is there: a small process makes a
 * bank (python -m synth.plugin.rebuild), and the instance goes over to it. Private to the plugin.
 *
 * A value that is set is a wish. A thread of the instance's own, which sleeps but for that, lets a moment pass in which more may
 * come, then looks for the bank in the user's cache or starts the process. When there is an engine of it, the audio thread takes it
 * at the start of a block; what sounded fades.
 */
#ifndef JAWARI_PLUGIN_REBUILD_H
#define JAWARI_PLUGIN_REBUILD_H

#include "plugin_private.h"

typedef struct plugin_rebuild plugin_rebuild;

/* ---- any thread but audio ---- */

/* False: there is no memory. */
bool plugin_rebuild_new(plugin *p);
void plugin_rebuild_free(plugin *p);

/* An engine to begin with: of what is wished, if that is in the cache, else as compiled in. NULL with `why`. */
jawari_engine *plugin_rebuild_create(plugin *p, double rate_hz, int32_t threads, bool host_threads, char *why);
/* Between these two, while the instance is active, wishes are fulfilled. The second is called while `engine` is still there. */
void plugin_rebuild_begin(plugin *p);
void plugin_rebuild_end(plugin *p);

/* The values of a state were taken over: goes over to their bank now, where it is in the cache. */
void plugin_rebuild_loaded(plugin *p);

/* As plugin_text, of a number of the setup: with what keeps it from being played. */
void plugin_rebuild_text(const plugin *p, uint32_t k, double value, char *text, size_t room);

/* Whether it can be changed at all. [any] */
bool plugin_rebuild_possible(const plugin *p);
/* A value was set. [any] */
void plugin_rebuild_wish(plugin *p);

/* ---- audio thread ---- */

/* Goes over to an engine that has arrived, at the start of a block, once this one has no event on its way and what sounded before
 * has faded. */
void plugin_rebuild_take(plugin *p);
/* Adds what fades. */
void plugin_rebuild_mix(plugin *p, int32_t frames, float *const narrow[2], double *const wide[2]);

/* ---- Python (plugin_python.c) ---- */

enum { PYTHON_PATH = 4096, PYTHON_VARIABLES = 16 };

typedef struct plugin_python {
    char program[PYTHON_PATH];
    char banks[PYTHON_PATH];  /* the folder of banks in the user's cache */
    char plugin[PYTHON_PATH]; /* the file with the bank that this code was loaded with */
    char *environment[PYTHON_VARIABLES + 1];
    int timeout_ms;
} plugin_python;

typedef struct plugin_child {
    int64_t id; /* 0: there is none */
    int in, out;
    char said[JAWARI_WHY];
    size_t size;
} plugin_child;

/* The Python to be used: JAWARI_PYTHON, or that of the last export of this version; false: there is none, or none that may be run
 * (it belongs to another user than this one or root, or everybody may write to it). */
bool plugin_python_find(plugin_python *python);
void plugin_python_free(plugin_python *python);
/* Whether a file and the folder that it lies in belong to the user or root, and not everybody may write there: many systems let a
 * group write where Python lies; but no group may write there either: a bank in the cache is made for the user alone. */
bool plugin_bank_trusted(const char *path);
/* Start the program; false with `why`. */
bool plugin_python_start(const plugin_python *python, char *const arguments[], plugin_child *child, char *why);
/* Reads what it says; whether it has ended. */
bool plugin_python_ended(plugin_child *child);
/* End it, if it has not, and forget it. Its last line stays in `said`. */
void plugin_python_end(plugin_child *child);

/* ---- between plugin_rebuild.c, plugin_wishes.c and plugin_maker.c ---- */

enum { SETUP_KEY = 33, SETUP_CHUNK = 512 };

/* An engine on its way to the audio thread, and the one before it on its way back. */
typedef struct plugin_handover {
    struct plugin_handover *next;
    jawari_engine *engine;
    double values[]; /* of the setup, as it plays them */
} plugin_handover;

/* What is wished: a bank by its key, "" for the plugin's own. */
typedef struct plugin_wish {
    char key[SETUP_KEY];
    uint32_t count;
    char **settings; /* "tanpura/string.length=0.9", of what is not as compiled in */
    double *values;
} plugin_wish;

enum { SETUP_PLAYED, SETUP_PREPARED, SETUP_FAILED };

struct plugin_rebuild {
    plugin_python python;
    bool there;
    int alarm[2]; /* ends of what wakes the thread, if `there` */
    void (*changed)(void *);
    void *whose;
    double rate_hz;
    int32_t threads, latency;
    bool host_threads, running;
    system_thread thread; /* if `running` */
    atomic_bool ending;
    _Atomic uint64_t *played; /* bits of the values that are played */

    system_guard guard;
    char key[SETUP_KEY];         /* of the engine that plays, or was handed over */
    int state;
    char why[JAWARI_WHY], remark[JAWARI_WHY]; /* remark: not yet said; empty */

    _Atomic(plugin_handover *) arriving;
    _Atomic(plugin_handover *) gone; /* a list, to be freed */

    /* audio thread */
    plugin_handover *leaving;
    int32_t faded, fade_frames, waited;
    double mix[2][SETUP_CHUNK];
};

/* What is wished at a rate. To be freed; NULL: there is no memory. */
plugin_wish *plugin_wish_of(const plugin *p, double rate_hz);
/* Whether two values are one to six significant digits, which is how they are asked for. */
bool plugin_same_number(double a, double b);
/* Hands an engine of a wish to the audio thread, if there is a bank of it; false with `why`. With the guard of `rebuild`. */
bool plugin_go_over(plugin *p, const plugin_wish *w, char *why);
/* Engines that the audio thread is done with go. */
void plugin_sweep_engines(const plugin *p);

/* ---- who makes banks (plugin_maker.c; plugin_alone.c: nobody) ---- */

/* Whether there is somebody; and what that one took is given back. */
bool plugin_maker_new(plugin_rebuild *r);
void plugin_maker_free(plugin_rebuild *r);
/* The thread that sees to wishes, from now until `ending`; false: there is none. */
bool plugin_maker_start(plugin *p);
/* Wakes it. [any] */
void plugin_wake(const plugin_rebuild *r);
/* The file of a bank by its key. */
void plugin_maker_path(const plugin *p, const char *key, char *path, size_t room);

#endif
