#include "checksum.h"
#include "system.h"

/* remainder[k][b]: of the byte b with k zero bytes behind it; eight bytes are then looked up at once (banks have megabytes) */
static uint32_t remainder_of[8][256];
static system_once filled;

static void fill(void) {
    for (uint32_t b = 0; b < 256; b++) {
        uint32_t crc = b;
        for (int bit = 0; bit < 8; bit++)
            crc = (crc >> 1) ^ (crc & 1 ? 0xedb88320u : 0);
        remainder_of[0][b] = crc;
    }
    for (int k = 1; k < 8; k++)
        for (uint32_t b = 0; b < 256; b++)
            remainder_of[k][b] = (remainder_of[k - 1][b] >> 8) ^ remainder_of[0][remainder_of[k - 1][b] & 255];
}

uint32_t crc32_of(uint32_t before, const void *data, size_t size) {
    const uint8_t *bytes = data;
    uint32_t crc = ~before;
    system_do_once(&filled, fill);
    for (; size >= 8; size -= 8, bytes += 8) {
        uint32_t low = crc ^ ((uint32_t)bytes[0] | (uint32_t)bytes[1] << 8 | (uint32_t)bytes[2] << 16 | (uint32_t)bytes[3] << 24);
        crc = remainder_of[7][low & 255] ^ remainder_of[6][low >> 8 & 255] ^ remainder_of[5][low >> 16 & 255] ^
              remainder_of[4][low >> 24] ^ remainder_of[3][bytes[4]] ^ remainder_of[2][bytes[5]] ^ remainder_of[1][bytes[6]] ^
              remainder_of[0][bytes[7]];
    }
    for (; size > 0; size--, bytes++)
        crc = crc >> 8 ^ remainder_of[0][(crc ^ *bytes) & 255];
    return ~crc;
}
