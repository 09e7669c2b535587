/* system_posix.h: what Linux and macOS do each in its own way of what both have: processes, pipes, signals. For the files that
 * are compiled only there. */
#ifndef JAWARI_SYSTEM_POSIX_H
#define JAWARI_SYSTEM_POSIX_H

#include <spawn.h>
#include "system.h"

/* As system_variable; NULL too where the program has rights that its user has not. */
const char *system_own_variable(const char *name);
/* A pipe whose ends no other program inherits: the one to read from, the one to write to. */
bool system_pipe(int ends[2]);
/* The same, for who polls: neither reading nor writing waits. The ends may be one. */
bool system_alarm(int ends[2]);
/* Lets a program start in a session of its own, with nothing that the host has left open, as far as the system can do it. */
bool system_spawn_apart(posix_spawn_file_actions_t *files, posix_spawnattr_t *how, short flags);

#endif
