/* vst3_text.c: UTF-8, as everything here has it, and UTF-16, as VST 3 wants it. */
#include <string.h>

#include "vst3.h"

/* The next character, U+FFFD for what is none; the text moves on by at least a byte. */
static uint32_t next_of_8(const uint8_t **at) {
    const uint8_t *s = *at;
    const uint32_t first = *s++;
    const uint32_t more = first < 0x80 ? 0 : first < 0xC2 ? 4 : first < 0xE0 ? 1 : first < 0xF0 ? 2 : first < 0xF5 ? 3 : 4;
    uint32_t c = more == 0 ? first : first & (0x3Fu >> more);
    *at = s;
    if (more == 4) return 0xFFFD;
    for (uint32_t k = 0; k < more; k++) {
        if ((s[k] & 0xC0) != 0x80) return 0xFFFD;
        c = c << 6 | (s[k] & 0x3F);
    }
    *at = s + more;
    return c;
}

void vst3_wide(int16_t *to, size_t room, const char *utf8) {
    const uint8_t *at = (const uint8_t *)utf8;
    size_t n = 0;
    while (*at) {
        const uint32_t c = next_of_8(&at), units = c < 0x10000 ? 1 : 2;
        if (n + units >= room) break;
        if (units == 1) {
            to[n++] = (int16_t)c;
        } else {
            to[n++] = (int16_t)(0xD800 + ((c - 0x10000) >> 10));
            to[n++] = (int16_t)(0xDC00 + ((c - 0x10000) & 0x3FF));
        }
    }
    to[n] = 0;
}

void vst3_narrow(char *to, size_t room, const int16_t *utf16) {
    size_t n = 0;
    while (*utf16) {
        uint32_t c = (uint16_t)*utf16++;
        const uint32_t low = (uint16_t)*utf16;
        if (c >= 0xD800 && c < 0xDC00 && low >= 0xDC00 && low < 0xE000) {
            c = 0x10000 + ((c - 0xD800) << 10) + (low - 0xDC00);
            utf16++;
        } else if (c >= 0xD800 && c < 0xE000) {
            c = 0xFFFD;
        }
        const size_t bytes = c < 0x80 ? 1 : c < 0x800 ? 2 : c < 0x10000 ? 3 : 4;
        if (n + bytes >= room) break;
        static const uint8_t lead[] = {0, 0, 0xC0, 0xE0, 0xF0};
        for (size_t k = bytes; k-- > 1; c >>= 6) to[n + k] = (char)(0x80 | (c & 0x3F));
        to[n] = (char)(lead[bytes] | c);
        n += bytes;
    }
    to[n] = 0;
}
