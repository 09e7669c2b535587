/* Windows. Nothing but KERNEL32 and the C runtime is needed. */
#define WIN32_LEAN_AND_MEAN
#include <windows.h>
#include <malloc.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include "system.h"
#include "system_kernels.h"

_Static_assert(sizeof(SRWLOCK) <= sizeof(system_guard), "fits into its room");

enum { HUNDRED_NS_A_S = 10000000, NS_A_S = 1000000000, MOST_PATH = 32768 };
/* from the year 1601 to 1970, in units of 100 ns */
#define EPOCH 116444736000000000ll

void *system_alloc(size_t border, size_t size) { return _aligned_malloc(size, border); }
void system_free(void *memory) { _aligned_free(memory); }

const char *system_variable(const char *name) { return getenv(name); }

void system_say(const char *format, ...) {
    va_list given;
    va_start(given, format);
    vfprintf(stderr, format, given);
    va_end(given);
    fputc('\n', stderr);
}

/* ---- guards and threads ---- */

/* a lock of zeros is SRWLOCK_INIT */
void system_lock(system_guard *guard) { AcquireSRWLockExclusive((SRWLOCK *)(void *)guard); }
void system_unlock(system_guard *guard) { ReleaseSRWLockExclusive((SRWLOCK *)(void *)guard); }

static DWORD WINAPI live(void *given) {
    system_thread *me = given;
    me->work(me->of);
    return 0;
}

bool system_thread_start(system_thread *thread, void (*work)(void *), void *of, size_t stack, bool apart) {
    thread->work = work;
    thread->of = of;
    HANDLE id = CreateThread(NULL, stack, live, thread, CREATE_SUSPENDED | (stack > 0 ? STACK_SIZE_PARAM_IS_A_RESERVATION : 0), NULL);
    if (id == NULL)
        return false;
    if (!apart)
        SetThreadPriority(id, GetThreadPriority(GetCurrentThread()));
    thread->id = (uintptr_t)id;
    ResumeThread(id);
    return true;
}

void system_thread_join(system_thread *thread) {
    WaitForSingleObject((HANDLE)thread->id, INFINITE);
    CloseHandle((HANDLE)thread->id);
}

int32_t system_processors(void) {
    DWORD_PTR mine, all;
    if (!GetProcessAffinityMask(GetCurrentProcess(), &mine, &all) || mine == 0)
        return 1;
    return __builtin_popcountll(mine);
}

void system_yield(void) { SwitchToThread(); }

static void sleep_for(int64_t hundred_ns) {
    /* exact from Windows 10 of 2018 on; else as many milliseconds */
    HANDLE timer = CreateWaitableTimerExW(NULL, NULL, CREATE_WAITABLE_TIMER_HIGH_RESOLUTION, TIMER_ALL_ACCESS);
    LARGE_INTEGER due = {.QuadPart = -hundred_ns};
    if (timer != NULL && SetWaitableTimer(timer, &due, 0, NULL, NULL, FALSE))
        WaitForSingleObject(timer, INFINITE);
    else
        Sleep((DWORD)((hundred_ns + 9999) / 10000));
    if (timer != NULL)
        CloseHandle(timer);
}

/* ---- tokens: a semaphore, whose handle has no more than 32 bits that count ---- */

static HANDLE handle_of(int32_t token) { return (HANDLE)(intptr_t)token; }

system_tokens system_tokens_new(void) {
    HANDLE made = CreateSemaphoreW(NULL, 0, LONG_MAX, NULL);
    const int32_t token = made == NULL ? -1 : (int32_t)(intptr_t)made;
    return (system_tokens){token, token};
}

void system_tokens_free(system_tokens tokens) { CloseHandle(handle_of(tokens.receive)); }

bool system_tokens_send(system_tokens tokens) { return ReleaseSemaphore(handle_of(tokens.send), 1, NULL) != 0; }

/* ---- files ---- */

system_file system_open(const char *path) {
    wchar_t *wide = malloc(MOST_PATH * sizeof *wide);
    HANDLE file = INVALID_HANDLE_VALUE;
    if (wide != NULL && MultiByteToWideChar(CP_UTF8, MB_ERR_INVALID_CHARS, path, -1, wide, MOST_PATH) > 0)
        file = CreateFileW(wide, GENERIC_READ, FILE_SHARE_READ | FILE_SHARE_DELETE, NULL, OPEN_EXISTING, FILE_ATTRIBUTE_NORMAL, NULL);
    const DWORD wrong = GetLastError();
    free(wide);
    SetLastError(wrong);
    return (system_file)file; /* the invalid one is −1 */
}

void system_close(system_file file) { CloseHandle((HANDLE)file); }

int64_t system_size(system_file file) {
    LARGE_INTEGER size;
    return GetFileType((HANDLE)file) == FILE_TYPE_DISK && GetFileSizeEx((HANDLE)file, &size) ? size.QuadPart : -1;
}

bool system_read_at(system_file file, uint64_t at, void *to, size_t size) {
    OVERLAPPED place = {.Offset = (DWORD)at, .OffsetHigh = (DWORD)(at >> 32)};
    DWORD got = 0;
    return ReadFile((HANDLE)file, to, (DWORD)size, &got, &place) && got == size;
}

const uint8_t *system_map_file(system_file file, uint64_t at, size_t size, system_map *map) {
    SYSTEM_INFO about;
    GetSystemInfo(&about);
    const uint64_t begin = at / about.dwAllocationGranularity * about.dwAllocationGranularity;
    HANDLE mapping = CreateFileMappingW((HANDLE)file, NULL, PAGE_READONLY, 0, 0, NULL);
    if (mapping == NULL)
        return NULL;
    const size_t whole = (size_t)(at - begin) + size;
    void *pages = MapViewOfFile(mapping, FILE_MAP_READ, (DWORD)(begin >> 32), (DWORD)begin, whole);
    const DWORD wrong = GetLastError();
    CloseHandle(mapping); /* the view holds it */
    SetLastError(wrong);
    if (pages == NULL)
        return NULL;
    *map = (system_map){pages, whole};
    return (const uint8_t *)pages + (at - begin);
}

void system_unmap(system_map *map) {
    if (map->pages != NULL)
        UnmapViewOfFile(map->pages);
    *map = (system_map){0};
}

static bool to_utf8(const wchar_t *from, char *to, int room) {
    return WideCharToMultiByte(CP_UTF8, 0, from, -1, to, room, NULL, NULL) > 0;
}

const char *system_reason(char text[SYSTEM_REASON]) {
    wchar_t wide[SYSTEM_REASON / 3];
    const DWORD wrong = GetLastError();
    DWORD size = FormatMessageW(FORMAT_MESSAGE_FROM_SYSTEM | FORMAT_MESSAGE_IGNORE_INSERTS, NULL, wrong, 0, wide,
                                sizeof wide / sizeof *wide, NULL);
    while (size > 0 && (wide[size - 1] <= L' ' || wide[size - 1] == L'.'))
        wide[--size] = 0;
    if (size == 0 || !to_utf8(wide, text, SYSTEM_REASON))
        snprintf(text, SYSTEM_REASON, "error %lu of Windows", (unsigned long)wrong);
    return text;
}

char *system_own_path(void) {
    static const wchar_t here = 0; /* lies in the library */
    HMODULE library;
    if (!GetModuleHandleExW(GET_MODULE_HANDLE_EX_FLAG_FROM_ADDRESS | GET_MODULE_HANDLE_EX_FLAG_UNCHANGED_REFCOUNT, &here, &library))
        return NULL;
    enum { ROOM = 3 * MOST_PATH };
    wchar_t *wide = malloc(MOST_PATH * sizeof *wide);
    char *path = malloc(ROOM);
    const DWORD size = wide != NULL ? GetModuleFileNameW(library, wide, MOST_PATH) : 0;
    if (path != NULL && (size == 0 || size >= MOST_PATH || !to_utf8(wide, path, ROOM))) {
        free(path);
        path = NULL;
    }
    free(wide);
    return path;
}

bool system_bank_beside(const char *library, char *path, size_t room) {
    (void)library, (void)path, (void)room;
    return false;
}

/* ---- what kernels call ---- */

static void put_time(int64_t time[2], int64_t hundred_ns) {
    time[0] = hundred_ns / HUNDRED_NS_A_S;
    time[1] = hundred_ns % HUNDRED_NS_A_S * 100;
}

static int64_t whole_of(FILETIME time) { return (int64_t)((uint64_t)time.dwHighDateTime << 32 | time.dwLowDateTime); }

int32_t jawari_system_clock_gettime(int32_t clock, int64_t time[2]) {
    FILETIME now, made, ended, in_system, in_program;
    LARGE_INTEGER count, a_second;
    switch (clock) {
    case CLOCK_OF_DAY:
        GetSystemTimePreciseAsFileTime(&now);
        put_time(time, whole_of(now) - EPOCH);
        return 0;
    case CLOCK_OF_THREAD:
        if (!GetThreadTimes(GetCurrentThread(), &made, &ended, &in_system, &in_program))
            return -1;
        put_time(time, whole_of(in_system) + whole_of(in_program));
        return 0;
    case CLOCK_STEADY:
        QueryPerformanceCounter(&count);
        QueryPerformanceFrequency(&a_second);
        time[0] = count.QuadPart / a_second.QuadPart;
        time[1] = count.QuadPart % a_second.QuadPart * NS_A_S / a_second.QuadPart;
        return 0;
    default:
        return -1;
    }
}

int32_t jawari_system_nanosleep(const int64_t time[2], int64_t left[2]) {
    (void)left;
    sleep_for(time[0] * HUNDRED_NS_A_S + (time[1] + 99) / 100);
    return 0;
}

int32_t jawari_system_sched_yield(void) {
    system_yield();
    return 0;
}

int64_t jawari_system_read(int32_t from, void *bytes, int64_t size) {
    (void)bytes;
    return WaitForSingleObject(handle_of(from), INFINITE) == WAIT_OBJECT_0 ? size : -1;
}

int64_t jawari_system_write(int32_t to, const void *bytes, int64_t size) {
    (void)bytes;
    return system_tokens_send((system_tokens){to, to}) ? size : -1;
}
