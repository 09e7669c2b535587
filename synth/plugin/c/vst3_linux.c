/* How a VST3 module begins and ends, and its class is known, on Linux. */
#include <string.h>
#include "vst3.h"

JAWARI_API bool ModuleEntry(void *library);
JAWARI_API bool ModuleExit(void);
bool ModuleEntry(void *library) {
    (void)library;
    return true;
}
bool ModuleExit(void) { return true; }

void vst3_class_id(const uint8_t uid[16], TUID id) { memcpy(id, uid, sizeof(TUID)); }
