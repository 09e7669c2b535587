/* processor.h: what the core needs of the processor; processor_NAME.c gives it. */
#ifndef JAWARI_PROCESSOR_H
#define JAWARI_PROCESSOR_H

/* Its level: on x86-64 of that name, from 1 to 4; 0 where there are none, or it is older than kernels for a level are. */
int processor_level(void);
/* Tells it that this is a loop that waits. */
void processor_pause(void);

#endif
