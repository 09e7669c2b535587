/* plugin_python.c: the user's Python, and a process of it that a host never notices.
 *
 * It is started without a copy of the host (posix_spawn), with no file of the host's, with signals as they are by default, in a
 * session of its own. That it has ended is known by its output, not by its exit code: a host may have taken that. It ends by itself
 * when its input does, so with the host.
 */
#define _GNU_SOURCE
#define _DARWIN_C_SOURCE
#include <errno.h>
#include <fcntl.h>
#include <signal.h>
#include <spawn.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include "core.h"
#include "plugin_rebuild.h"
#include "system_posix.h"

enum { PATIENCE_S = 300 }; /* without the native library all kernels are compiled first */

/* ---- who may be run ---- */

static bool ours(const struct stat *about, mode_t open_to) {
    return (about->st_uid == 0 || about->st_uid == geteuid()) && !(about->st_mode & open_to);
}

/* Whether a file and its folder are the user's or root's, and those who are `open_to` cannot write there. */
static bool trusted(const char *path, mode_t open_to) {
    char folder[PYTHON_PATH];
    struct stat about, around;
    plugin_copy_text(folder, sizeof folder, path);
    char *last = strrchr(folder, '/');
    if (path[0] != '/' || last == NULL || strlen(path) >= sizeof folder)
        return false;
    *(last == folder ? last + 1 : last) = 0;
    return stat(path, &about) == 0 && stat(folder, &around) == 0 && ours(&about, open_to) && ours(&around, open_to);
}

static bool python_trusted(const char *path) { return trusted(path, S_IWOTH); }
bool plugin_bank_trusted(const char *path) { return trusted(path, S_IWOTH | S_IWGRP); }

static bool runnable(const char *path) {
    struct stat about;
    return python_trusted(path) && stat(path, &about) == 0 && S_ISREG(about.st_mode) && access(path, X_OK) == 0;
}

/* ---- where it is ---- */

/* The user's cache of this program; false: there is no home. */
static bool cache(char *to, size_t room) {
    const char *base = system_own_variable("XDG_CACHE_HOME"), *home = system_own_variable("HOME");
    int size = -1;
    if (base && *base == '/')
        size = snprintf(to, room, "%s/jawari", base);
    else if (home && *home == '/')
        size = snprintf(to, room, "%s/.cache/jawari", home);
    return size > 0 && (size_t)size < room;
}

/* What the last export of this version has written: the interpreter, and the folder of the package. */
static bool read_record(const char *folder, char *program, char *packages) {
    char path[PYTHON_PATH + 64], text[2 * PYTHON_PATH];
    snprintf(path, sizeof path, "%s/python-%s", folder, jawari_kernels_version());
    const int file = python_trusted(path) ? open(path, O_RDONLY | O_CLOEXEC | O_NOFOLLOW) : -1;
    if (file < 0)
        return false;
    const ssize_t size = read(file, text, sizeof text - 1);
    close(file);
    text[size > 0 ? size : 0] = 0;
    char *end = strchr(text, '\n'), *second = end ? strchr(end + 1, '\n') : NULL;
    if (!second || end - text >= PYTHON_PATH || second - end >= PYTHON_PATH)
        return false;
    *end = *second = 0;
    plugin_copy_text(program, PYTHON_PATH, text);
    plugin_copy_text(packages, PYTHON_PATH, end + 1);
    char package[PYTHON_PATH + 16];
    snprintf(package, sizeof package, "%s/synth", packages);
    return python_trusted(package);
}

static bool put_variable(plugin_python *python, const char *name, const char *value) {
    int k = 0;
    while (k < PYTHON_VARIABLES && python->environment[k])
        k++;
    if (!value || k == PYTHON_VARIABLES)
        return !value;
    const size_t size = strlen(name) + strlen(value) + 2;
    python->environment[k] = malloc(size);
    if (python->environment[k])
        snprintf(python->environment[k], size, "%s=%s", name, value);
    return python->environment[k] != NULL;
}

bool plugin_python_find(plugin_python *python) {
    /* OpenBLAS's: they choose its kernels, and with them the last bits of what is compiled */
    static const char *const passed[] = {"HOME",
                                         "PATH",
                                         "USER",
                                         "LANG",
                                         "TMPDIR",
                                         "XDG_CACHE_HOME",
                                         "JAWARI_NATIVE",
                                         "OPENBLAS_CORETYPE",
                                         "OPENBLAS_L2_SIZE",
                                         "OPENBLAS_NUM_THREADS"};
    char folder[PYTHON_PATH - 16], packages[PYTHON_PATH] = "";
    memset(python, 0, sizeof *python);
    const char *own = bank_own_file();
    if (!cache(folder, sizeof folder) || !own || strlen(own) >= sizeof python->plugin)
        return false;
    plugin_copy_text(python->plugin, sizeof python->plugin, own);
    snprintf(python->banks, sizeof python->banks, "%s/banks", folder);
    const char *asked = system_own_variable("JAWARI_PYTHON"), *patience = system_own_variable("JAWARI_PYTHON_TIMEOUT");
    if (asked && *asked)
        plugin_copy_text(python->program, sizeof python->program, asked);
    else if (!read_record(folder, python->program, packages))
        return false;
    if (!runnable(python->program))
        return false;
    const int seconds = patience ? atoi(patience) : 0;
    python->timeout_ms = 1000 * (seconds > 0 && seconds <= 86400 ? seconds : PATIENCE_S);
    /* a host's own Python, and libraries that it puts before others', are none of this one's business */
    bool made = put_variable(python, "PYTHONSAFEPATH", "1"); /* nor is the folder that the host stands in */
    made = made && put_variable(python, "PYTHONPATH", asked && *asked ? system_own_variable("PYTHONPATH") : packages);
    for (size_t k = 0; k < sizeof passed / sizeof *passed; k++)
        made = made && put_variable(python, passed[k], system_own_variable(passed[k]));
    if (!made)
        plugin_python_free(python);
    return made;
}

void plugin_python_free(plugin_python *python) {
    for (int k = 0; k < PYTHON_VARIABLES; k++) {
        free(python->environment[k]);
        python->environment[k] = NULL;
    }
}

/* ---- a process ---- */

static bool set_up(posix_spawn_file_actions_t *files, posix_spawnattr_t *how, int in, int out) {
    sigset_t none, all;
    sigemptyset(&none);
    sigfillset(&all);
    int wrong = posix_spawn_file_actions_adddup2(files, in, 0) | posix_spawn_file_actions_adddup2(files, out, 1) |
                posix_spawn_file_actions_adddup2(files, out, 2);
    wrong |= posix_spawnattr_setsigmask(how, &none) | posix_spawnattr_setsigdefault(how, &all);
    return system_spawn_apart(files, how, POSIX_SPAWN_SETSIGMASK | POSIX_SPAWN_SETSIGDEF) && wrong == 0;
}

static void close_both(const int ends[2]) {
    for (int k = 0; k < 2; k++)
        if (ends[k] >= 0)
            close(ends[k]);
}

bool plugin_python_start(const plugin_python *python, char *const arguments[], plugin_child *child, char *why) {
    int in[2] = {-1, -1}, out[2] = {-1, -1}, wrong = 0;
    pid_t id = 0;
    *child = (plugin_child){.in = -1, .out = -1};
    posix_spawn_file_actions_t files;
    posix_spawnattr_t how;
    if (!system_pipe(in) || !system_pipe(out))
        wrong = errno;
    else if (posix_spawn_file_actions_init(&files))
        wrong = ENOMEM;
    else {
        if (posix_spawnattr_init(&how))
            wrong = ENOMEM;
        else {
            wrong = set_up(&files, &how, in[0], out[1])
                        ? posix_spawn(&id, python->program, &files, &how, arguments, python->environment)
                        : ENOMEM;
            posix_spawnattr_destroy(&how);
        }
        posix_spawn_file_actions_destroy(&files);
    }
    if (wrong) {
        close_both(in);
        close_both(out);
        snprintf(why, JAWARI_WHY, "%.300s cannot be started: %s", python->program, strerror(wrong));
        return false;
    }
    close(in[0]);
    close(out[1]);
    fcntl(out[0], F_SETFL, O_NONBLOCK);
    child->id = id;
    child->in = in[1];
    child->out = out[0];
    return true;
}

bool plugin_python_ended(plugin_child *child) {
    for (;;) {
        char more[256];
        const ssize_t size = read(child->out, more, sizeof more);
        if (size < 0 && errno == EINTR)
            continue;
        if (size < 0)
            return errno != EAGAIN && errno != EWOULDBLOCK;
        if (size == 0)
            return true;
        /* the last that it has said is kept */
        const size_t most = sizeof child->said - 1, length = (size_t)size;
        if (child->size + length > most) {
            const size_t gone = child->size + length - most;
            memmove(child->said, child->said + gone, child->size - gone);
            child->size -= gone;
        }
        memcpy(child->said + child->size, more, length);
        child->size += length;
        child->said[child->size] = 0;
    }
}

/* The last line, of printable characters. */
static void keep_last_line(plugin_child *child) {
    char *said = child->said;
    size_t size = child->size;
    while (size > 0 && (unsigned char)said[size - 1] <= ' ')
        size--;
    said[size] = 0;
    const char *line = strrchr(said, '\n');
    line = line ? line + 1 : said;
    memmove(said, line, strlen(line) + 1);
    for (char *c = said; *c; c++)
        if ((unsigned char)*c < ' ')
            *c = ' ';
}

void plugin_python_end(plugin_child *child) {
    if (child->id == 0)
        return;
    const pid_t id = (pid_t)child->id;
    siginfo_t about = {0};
    /* a host that waits for all children may have this one's end already: its number is another's then */
    if (waitid(P_PID, (id_t)id, &about, WEXITED | WNOHANG | WNOWAIT) == 0 && about.si_pid == 0)
        kill(id, SIGKILL);
    while (waitpid(id, NULL, 0) < 0 && errno == EINTR) {
    }
    close(child->in);
    close(child->out);
    child->id = 0;
    keep_last_line(child);
}
