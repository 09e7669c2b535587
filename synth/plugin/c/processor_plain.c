/* A processor of which nothing is known. */
#include "processor.h"

int processor_level(void) { return 0; }
void processor_pause(void) {}
