/* How a VST3 module begins and ends, and its class is known, on macOS. */
#include <string.h>
#include "vst3.h"

JAWARI_API bool bundleEntry(void *bundle);
JAWARI_API bool bundleExit(void);
bool bundleEntry(void *bundle) { return bundle != NULL; }
bool bundleExit(void) { return true; }

void vst3_class_id(const uint8_t uid[16], TUID id) { memcpy(id, uid, sizeof(TUID)); }
