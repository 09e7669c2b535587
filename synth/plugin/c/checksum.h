/* checksum.h: CRC-32 (the polynomial of IEEE 802.3, as zlib counts it). */
#ifndef JAWARI_CHECKSUM_H
#define JAWARI_CHECKSUM_H

#include <stddef.h>
#include <stdint.h>

/* Of `before`, 0 at first, and what follows it. */
uint32_t crc32_of(uint32_t before, const void *data, size_t size);

#endif
