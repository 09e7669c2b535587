/* ARM's of 64 bits: kernels need no more than all of them have. */
#include "processor.h"

int processor_level(void) { return 0; }
void processor_pause(void) { __asm__ volatile("yield"); }
