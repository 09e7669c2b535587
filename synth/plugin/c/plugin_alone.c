/* plugin_alone.c: nobody makes banks of other setups where a plugin can start no process; it plays as it was compiled. */
#include "plugin_rebuild.h"

bool plugin_maker_new(plugin_rebuild *r) {
    (void)r;
    return false;
}

void plugin_maker_free(plugin_rebuild *r) { (void)r; }

bool plugin_maker_start(plugin *p) {
    (void)p;
    return false;
}

void plugin_wake(const plugin_rebuild *r) { (void)r; }

void plugin_maker_path(const plugin *p, const char *key, char *path, size_t room) {
    (void)p, (void)key;
    plugin_copy_text(path, room, "");
}

bool plugin_bank_trusted(const char *path) {
    (void)path;
    return false;
}
