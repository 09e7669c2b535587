/* system_kernels.h: what kernels call of the system, in the place of Linux's functions whose meaning they have: a time is two
 * numbers of 64 bits, seconds and nanoseconds. `emit` renames the calls for every system but Linux. */
#ifndef JAWARI_SYSTEM_KERNELS_H
#define JAWARI_SYSTEM_KERNELS_H

#include <stdint.h>

#define KERNELS_CALL __attribute__((visibility("hidden")))

/* clocks, by Linux's numbers */
enum { CLOCK_OF_DAY = 0, CLOCK_STEADY = 1, CLOCK_OF_THREAD = 3 };

KERNELS_CALL int32_t jawari_system_clock_gettime(int32_t clock, int64_t time[2]);
KERNELS_CALL int32_t jawari_system_nanosleep(const int64_t time[2], int64_t left[2]);
KERNELS_CALL int32_t jawari_system_sched_yield(void);
/* Eight bytes, of system_tokens: how many went through. */
KERNELS_CALL int64_t jawari_system_read(int32_t from, void *bytes, int64_t size);
KERNELS_CALL int64_t jawari_system_write(int32_t to, const void *bytes, int64_t size);

#endif
