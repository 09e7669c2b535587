/* x86-64, whose levels are those that compilers name. */
#include <cpuid.h>
#include <stdint.h>
#include "processor.h"

/* What the system saves of the vector registers when it changes threads. */
static uint64_t saved_registers(void) {
    uint32_t low, high;
    __asm__ volatile("xgetbv" : "=a"(low), "=d"(high) : "c"(0));
    return (uint64_t)high << 32 | low;
}

int processor_level(void) {
    uint32_t a, b, c, d, b7, extended;
    /* of leaf 1: SSE3, SSSE3, FMA, CMPXCHG16B, SSE4.1, SSE4.2, MOVBE, POPCNT, OSXSAVE, AVX, F16C */
    const uint32_t wanted_1 = 1u << 0 | 1u << 9 | 1u << 12 | 1u << 13 | 1u << 19 | 1u << 20 | 1u << 22 | 1u << 23 | 1u << 27 |
                              1u << 28 | 1u << 29;
    const uint32_t wanted_7 = 1u << 3 | 1u << 5 | 1u << 8; /* BMI1, AVX2, BMI2 */
    const uint32_t wanted_512 = 1u << 16 | 1u << 17 | 1u << 28 | 1u << 30 | 1u << 31; /* F, DQ, CD, BW, VL */
    if (!__get_cpuid(1, &a, &b, &c, &d) || (c & wanted_1) != wanted_1)
        return 0;
    if (!__get_cpuid_count(7, 0, &a, &b7, &c, &d) || (b7 & wanted_7) != wanted_7)
        return 0;
    if (!__get_cpuid(0x80000001u, &a, &b, &extended, &d) || !(extended & 1u << 5)) /* LZCNT */
        return 0;
    const uint64_t saved = saved_registers();
    if ((saved & 0x06) != 0x06) /* XMM, YMM */
        return 0;
    return (b7 & wanted_512) == wanted_512 && (saved & 0xe6) == 0xe6 ? 4 : 3; /* …, masks, ZMM */
}

void processor_pause(void) { __builtin_ia32_pause(); }
