/* plugin_wishes.c: what setup is wished of an instance; see plugin_rebuild.h. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "plugin_rebuild.h"

bool plugin_same_number(double a, double b) {
    char one[48], other[48];
    plugin_write_number(one, sizeof one, a);
    plugin_write_number(other, sizeof other, b);
    return strcmp(one, other) == 0;
}

/* FNV-1a of 64 bits. */
static uint64_t hashed(uint64_t hash, const char *text) {
    do
        hash = (hash ^ (uint8_t)*text) * 1099511628211u;
    while (*text++);
    return hash;
}

plugin_wish *plugin_wish_of(const plugin *p, double rate_hz) {
    enum { LINE = 224 };
    plugin_wish *w = calloc(1, sizeof *w + p->setups * (sizeof(double) + sizeof(char *) + LINE));
    if (!w)
        return NULL;
    w->values = (double *)(void *)(w + 1);
    w->settings = (char **)(void *)(w->values + p->setups);
    char *line = (char *)(w->settings + p->setups), text[64];
    snprintf(text, sizeof text, "%08x %.17g", jawari_bank_checksum(p->bank), rate_hz);
    uint64_t hash[2] = {hashed(14695981039346656037u, text), hashed(1099511628211u, text)};
    for (int h = 0; h < 2; h++)
        hash[h] = hashed(hash[h], jawari_kernels_version());
    for (uint32_t j = 0; j < p->setups; j++) {
        const plugin_parameter *q = &p->parameters[p->of_presets + j];
        w->values[j] = plugin_value(p, p->of_presets + j);
        if (plugin_same_number(w->values[j], q->initial))
            continue;
        plugin_write_number(text, sizeof text, w->values[j]);
        snprintf(line, LINE, "%s=%s", q->id, text);
        for (int h = 0; h < 2; h++)
            hash[h] = hashed(hash[h], line);
        w->settings[w->count++] = line;
        line += LINE;
    }
    if (w->count)
        snprintf(w->key, sizeof w->key, "%016llx%016llx", (unsigned long long)hash[0], (unsigned long long)hash[1]);
    return w;
}
