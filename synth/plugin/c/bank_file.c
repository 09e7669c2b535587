/* Banks in files: of their own, behind the end of a library, beside one. They are mapped and read only. */
#include <stdlib.h>
#include <string.h>
#include "core.h"

static const char BEGIN[8] = {'J', 'A', 'W', 'A', 'R', 'I', 'B', 'K'};
static const char FOOT[8] = {'J', 'A', 'W', 'A', 'R', 'I', 'F', 'T'};
enum { LONGEST_PATH = 4096 };

/* Where the bank begins in an open file, and how many bytes there are for it. */
static bool find(system_file file, const char *path, uint64_t *at, uint64_t *room, char *why) {
    struct {
        uint64_t at;
        char foot[8];
    } end;
    char begin[sizeof BEGIN];
    const int64_t whole = system_size(file);
    if (whole < 0) {
        core_say(why, "%s is no file; name a bank or a plugin", path);
        return false;
    }
    const uint64_t size = (uint64_t)whole;
    if (size >= sizeof begin && system_read_at(file, 0, begin, sizeof begin) && memcmp(begin, BEGIN, sizeof BEGIN) == 0) {
        *at = 0;
        *room = size;
        return true;
    }
    if (size < sizeof end || !system_read_at(file, size - sizeof end, &end, sizeof end) ||
        memcmp(end.foot, FOOT, sizeof FOOT) != 0) {
        core_say(why, "there is no bank in %s; export presets into it", path);
        return false;
    }
    if (end.at % JAWARI_BORDER != 0 || end.at >= size - sizeof end) {
        core_say(why, "%s holds no bank that can be played: its place is outside of the file; export it again", path);
        return false;
    }
    *at = end.at;
    *room = size - sizeof end - end.at;
    return true;
}

static jawari_bank *open_file(system_file file, const char *path, char *why) {
    uint64_t at, room;
    system_map map = {0};
    if (core_kernels(why) == NULL || !find(file, path, &at, &room, why))
        return NULL;
    const uint8_t *bytes = system_map_file(file, at, (size_t)room, &map);
    if (bytes == NULL) {
        char reason[SYSTEM_REASON];
        core_say(why, "%s cannot be mapped: %s", path, system_reason(reason));
        return NULL;
    }
    jawari_bank *bank = bank_of_bytes(bytes, room, path, why);
    if (bank == NULL)
        system_unmap(&map);
    else
        bank->map = map;
    return bank;
}

jawari_bank *jawari_open(const char *path, char *why) {
    if (path == NULL) {
        core_say(why, "no file was named; name a bank or a plugin");
        return NULL;
    }
    const system_file file = system_open(path);
    if (file < 0) {
        char reason[SYSTEM_REASON];
        core_say(why, "%s cannot be read: %s", path, system_reason(reason));
        return NULL;
    }
    jawari_bank *bank = open_file(file, path, why);
    system_close(file);
    return bank;
}

/* ---- the library's own ---- */

/* A file, kept open: an export may replace it meanwhile, and of a file with several names (the formats of one export) the one by
 * which it was loaded may go. Its path from the root on is for messages: it may have been named from a folder that the program
 * leaves later. */
struct place {
    char *path;       /* NULL: it is not known, or there is none */
    system_file file; /* below 0: it cannot be opened */
};

/* The file from which the library was loaded, and the one beside it for a bank. Neither environment, nor working directory, nor a
 * state can name others. */
static struct place library = {NULL, -1}, beside = {NULL, -1};

__attribute__((constructor)) static void find_own_files(void) {
    char path[LONGEST_PATH];
    library.path = system_own_path();
    if (library.path == NULL)
        return;
    library.file = system_open(library.path);
    if (system_bank_beside(library.path, path, sizeof path)) {
        beside.path = malloc(strlen(path) + 1);
        if (beside.path == NULL)
            return;
        strcpy(beside.path, path);
        beside.file = system_open(path);
    }
}

static void forget(struct place *place) {
    if (place->file >= 0)
        system_close(place->file);
    free(place->path);
    *place = (struct place){NULL, -1};
}

__attribute__((destructor)) static void forget_own_files(void) {
    forget(&library);
    forget(&beside);
}

/* The one beside counts where nothing stands behind the library's end. */
static const struct place *own_place(void) {
    uint64_t at, room;
    return beside.file >= 0 && !(library.file >= 0 && find(library.file, library.path, &at, &room, NULL)) ? &beside : &library;
}

const char *bank_own_file(void) { return own_place()->path; }

static jawari_bank *open_own(char *why) {
    const struct place *place = own_place();
    return open_file(place->file, place->path, why);
}

jawari_bank *jawari_open_own(char *why) {
    if (library.path == NULL) {
        core_say(why, "the system does not say from which file the library was loaded");
        return NULL;
    }
    if (library.file < 0) {
        core_say(why, "%s could not be read when it was loaded; load it again", library.path);
        return NULL;
    }
    return bank_own(open_own, why);
}
