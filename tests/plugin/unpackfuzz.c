/* unpackfuzz FILE COUNT SEED: so many changed packed banks, each unpacked from memory and into memory of exactly its size; says how
 * many were refused, how many of these without a reason, and how many were not though they gave another bank. To be compiled with -fsanitize=address,undefined. */
#include "jawari.h"
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static uint64_t state;

static uint64_t any(uint64_t below) {
    state ^= state << 13;
    state ^= state >> 7;
    state ^= state << 17;
    return state % below;
}

/* A few bytes or words changed, most of them near the beginning, where the header and the small tables are; perhaps an end cut off. */
static size_t change(uint8_t *bytes, size_t size) {
    const uint64_t edits = 1 + any(6);
    for (uint64_t k = 0; k < edits; k++) {
        const uint64_t where[] = {any(288 < size ? 288 : size), any(4096 < size ? 4096 : size), any(size)};
        const uint64_t at = where[any(3)];
        static const uint64_t words[] = {0, 1, 255, 65536, 0x7fffffff, 0xffffffff, 0x7fffffffffffffff, 0xffffffffffffffff};
        const uint64_t word = any(2) ? words[any(8)] : any(UINT64_MAX) >> any(64);
        if (at < 8 && any(8)) /* else little gets further */
            continue;
        if (any(2))
            bytes[at] = (uint8_t)word;
        else
            memcpy(bytes + at, &word, size - at < 8 ? size - at : 8);
    }
    if (any(8) == 0) {
        size -= any(size);
        if (any(2) && size >= 32) {
            const uint64_t said = size;
            memcpy(bytes + 24, &said, 8);
        }
    }
    return size;
}

int main(int argc, char **argv) {
    FILE *file = argc == 4 ? fopen(argv[1], "rb") : NULL;
    if (file == NULL || fseek(file, 0, SEEK_END) != 0)
        return 2;
    const long length = ftell(file);
    if (length <= 0)
        return 2;
    rewind(file);
    const size_t size = (size_t)length;
    uint8_t *whole = malloc(size), *changed = malloc(size);
    if (whole == NULL || changed == NULL || fread(whole, 1, size, file) != size)
        return 2;
    state = strtoull(argv[3], NULL, 10) * 2654435761u + 88172645463325252u;
    long refused = 0, silent = 0, wrong = 0;
    const int64_t right_size = jawari_unpacked_size(whole, size);
    void *right = malloc(right_size > 0 ? (size_t)right_size : 1);
    if (right == NULL || jawari_unpack(whole, size, right, (size_t)right_size, NULL) != 0)
        return 2;
    const long count = strtol(argv[2], NULL, 10);
    for (long k = 0; k < count; k++) {
        memcpy(changed, whole, size);
        const size_t left = change(changed, size);
        uint8_t *packed = malloc(left + 1);
        if (packed == NULL)
            return 2;
        memcpy(packed + 1, changed, left); /* on no border */
        const int64_t room = jawari_unpacked_size(packed + 1, left);
        if (room < 0 || room > 1 << 28) {
            refused++;
        } else {
            char why[JAWARI_WHY] = "";
            void *out = malloc(room ? (size_t)room : 1);
            if (out == NULL)
                return 2;
            if (jawari_unpack(packed + 1, left, out, (size_t)room, why) != 0) {
                refused++;
                silent += why[0] == 0;
            } else {
                wrong += room != right_size || memcmp(out, right, (size_t)room) != 0;
            }
            free(out);
        }
        free(packed);
    }
    printf("%ld %ld %ld\n", refused, silent, wrong);
    free(right);
    free(whole);
    free(changed);
    fclose(file);
    return 0;
}
