/* How a VST3 module begins and ends, and its class is known, on Windows. */
#include "vst3.h"

JAWARI_API bool InitDll(void);
JAWARI_API bool ExitDll(void);
bool InitDll(void) { return true; }
bool ExitDll(void) { return true; }

/* An id there is COM's: a number of 32 bits, two of 16, each with its lowest byte first, and eight bytes. */
void vst3_class_id(const uint8_t uid[16], TUID id) {
    static const uint8_t from[16] = {3, 2, 1, 0, 5, 4, 7, 6, 8, 9, 10, 11, 12, 13, 14, 15};
    for (int k = 0; k < 16; k++)
        id[k] = uid[from[k]];
}
