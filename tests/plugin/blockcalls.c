/* blockcalls BANK: plays a bank and counts what a block must not do: allocations, locks, files.
 *
 * Prints how often that happened in blocks, then how often it happens when memory is taken and given back: 2, if counting works;
 * then whether notes were played. */
#define _GNU_SOURCE
#include <dlfcn.h>
#include <pthread.h>
#include <stdint.h>
#include <stdio.h>
#include "jawari.h"

static __thread int watched;
static long counted;
static void count(void) {
    if (watched)
        __atomic_add_fetch(&counted, 1, __ATOMIC_RELAXED);
}

extern void *__libc_malloc(size_t size), *__libc_calloc(size_t n, size_t size), *__libc_realloc(void *p, size_t size);
extern void *__libc_memalign(size_t border, size_t size);
extern void __libc_free(void *p);

void *malloc(size_t size) {
    count();
    return __libc_malloc(size);
}
void *calloc(size_t n, size_t size) {
    count();
    return __libc_calloc(n, size);
}
void *realloc(void *p, size_t size) {
    count();
    return __libc_realloc(p, size);
}
int posix_memalign(void **p, size_t border, size_t size) {
    count();
    *p = __libc_memalign(border, size);
    return *p == NULL ? 12 : 0;
}
void free(void *p) {
    count();
    __libc_free(p);
}
int pthread_mutex_lock(pthread_mutex_t *mutex) {
    static int (*real)(pthread_mutex_t *);
    if (!real)
        real = (int (*)(pthread_mutex_t *))dlsym(RTLD_NEXT, "pthread_mutex_lock");
    count();
    return real(mutex);
}
int open(const char *path, int flags, ...) {
    static int (*real)(const char *, int, ...);
    if (!real)
        real = (int (*)(const char *, int, ...))dlsym(RTLD_NEXT, "open");
    count();
    return real(path, flags);
}

static double left[4096], right[4096];
static jawari_event events[600];
static uint32_t dice = 1;

static uint8_t data(void) {
    dice = dice * 1664525u + 1013904223u;
    return (uint8_t)(dice >> 24) & 0x7f;
}

int main(int n, char **given) {
    char why[JAWARI_WHY] = "";
    jawari_bank *bank = n == 2 ? jawari_open(given[1], why) : NULL;
    jawari_engine *engine = jawari_create(bank, 44100.0, 2, why);
    if (engine == NULL) {
        puts(why);
        return 1;
    }
    watched = 1;
    for (int block = 0; block < 150; block++) {
        int32_t held = 0;
        for (int k = 0; k < 12; k++) {
            uint8_t message[3] = {data(), data(), data()};
            message[0] = (uint8_t)(0x80 | (message[0] & 0x73));
            held += jawari_midi(message, 3, k * 20, events + held, 600 - held);
            events[held++] = (jawari_event){k * 20, JAWARI_PARAMETER, 0, k % 6, 0, 0.01 * data()};
        }
        jawari_process(engine, events, held, block % 2 ? 333 : 4096, left, right);
        if (block == 70)
            jawari_reset(engine);
    }
    watched = 0;
    const long in_blocks = counted;
    watched = 1;
    free(malloc(1));
    watched = 0;
    jawari_report report;
    jawari_report_of(engine, &report);
    printf("%ld %ld %d\n", in_blocks, counted - in_blocks, report.notes > 100);
    jawari_destroy(engine);
    jawari_close(bank);
    return 0;
}
