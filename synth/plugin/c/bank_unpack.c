/* Packed banks made into banks again: what packed_bank.py packs. Whatever the bytes are, nothing outside of them is read and nothing
 * outside of the room is written; what is not exactly a packed bank is refused.
 */
#include "bank_predict.h"
#include "checksum.h"
#include "jawari.h"
#include <stdbool.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

/* as packed_models.TABLES, …WEIGHING, …MODEL, …NUMBERS, …STRING_INTEGERS, packed_bank.KINDS */
enum { OMEGA, SIGMA, RESIDUAL, SHAPES, ROWS_OF, WEIGHTS, MATRIX, LAGS, OUT_LAGS, SINGLE_ROWS, SINGLE_SHAPES, SINGLE_WEIGHTS, TABLES };
enum { PLAIN, HEARD, FILTERED, SMOOTH };
enum {
    MODES,
    OWN,
    SIZE,
    CONTACTS,
    LAGGED,
    SINGLES,
    ON_Q,
    VELOCITY,
    STRING,
    WEIGHING,
    FIRST_TAP,
    TAPS,
    BASE,
    MAKES,
    FIRST_TABLE,
    MODEL = FIRST_TABLE + TABLES
};
enum { MU, DT, RATIO, LOSS, PLACE, HALF, GAIN_Q, GAIN_V, RATE, NUMBERS };
enum { LINEAR, FIRST_NUT, NUTS, STRING_INTEGERS };
enum { INTEGERS, FLOATS, FIRST_KIND, KINDS = FIRST_KIND + TABLES };
enum { GAP, BYTES, WORDS, AREA };

enum { VERSION = 1, FIRST_LONG = 200, MOST_LONG = 36, MOST_ROWS = 1 << 16 };
#define MOST_UNPACKED ((uint64_t)1 << 31)
/* Steps of prediction for a byte of a packed bank: banks that are exported need some ten, and no bank of some megabytes takes longer
 * than seconds. */
enum { MOST_STEPS = 512 };

struct packed_header {
    char magic[8];
    uint32_t version, checksum;
    uint64_t unpacked, size;
    uint32_t models, strings, nuts, taps, places, areas;
    uint64_t streams[KINDS][2];
    uint64_t rest;
};
_Static_assert(sizeof(struct packed_header) == 64 + 16 * KINDS, "as packed_bank.PACKED");

/* Codes and what follows them. */
struct stream {
    const uint8_t *codes, *codes_end, *more, *more_end;
};

struct unpacking {
    struct packed_header h;
    struct stream streams[KINDS];
    const uint8_t *rest, *rest_end;
    uint8_t *out;
    uint64_t room;
    int64_t (*models)[MODEL];
    double (*numbers)[NUMBERS];
    int64_t (*string_integers)[STRING_INTEGERS];
    double (*strings)[PREDICT_STRING];
    double *nuts, *taps, *places;
    int64_t (*areas)[AREA];
    uint8_t first[MOST_LONG], count[MOST_LONG]; /* bytes of long codes */
    bool ended;                                 /* a stream ended too early, or a code was none */
};

static int refuse(char *why, const char *what) {
    if (why)
        snprintf(why, JAWARI_WHY, "this packed bank cannot be unpacked: %s; load it again", what);
    return -1;
}

/* The next difference of a stream; 0 behind its end. */
static uint64_t next(struct unpacking *u, int kind) {
    struct stream *s = &u->streams[kind];
    if (s->codes == s->codes_end) {
        u->ended = true;
        return 0;
    }
    const uint8_t code = *s->codes++;
    uint64_t folded = code;
    if (code >= FIRST_LONG) {
        const int number = code - FIRST_LONG;
        if (number >= MOST_LONG || s->more_end - s->more < u->count[number]) {
            u->ended = true;
            return 0;
        }
        folded = 0;
        for (int k = 0; k < u->count[number]; k++)
            folded |= (uint64_t)*s->more++ << 8 * (u->first[number] + k);
    }
    return (folded >> 1) ^ (0 - (folded & 1));
}

/* float64 as integers that rise as it does, and back; the same of float32. */
static uint64_t ordered(uint64_t word) { return word >> 63 ? word ^ 0x7fffffffffffffffu : word; }
static uint32_t ordered_single(uint32_t word) { return word >> 31 ? word ^ 0x7fffffffu : word; }

/* What was predicted, and what it differs by. */
static void correct(struct unpacking *u, int kind, double *numbers, size_t count) {
    for (size_t k = 0; k < count; k++) {
        uint64_t word;
        memcpy(&word, &numbers[k], sizeof word);
        word = ordered(ordered(word) + next(u, kind));
        memcpy(&numbers[k], &word, sizeof word);
    }
}

static void correct_single(struct unpacking *u, int kind, float *numbers, size_t count) {
    for (size_t k = 0; k < count; k++) {
        uint32_t word;
        memcpy(&word, &numbers[k], sizeof word);
        word = ordered_single(ordered_single(word) + (uint32_t)next(u, kind));
        memcpy(&numbers[k], &word, sizeof word);
    }
}

/* Numbers whose third differences are stored. */
static void smooth(struct unpacking *u, int kind, double *numbers, size_t count) {
    uint64_t first = 0, second = 0, third = 0;
    for (size_t k = 0; k < count; k++) {
        first += next(u, kind);
        second += first;
        third += second;
        const uint64_t word = ordered(third);
        memcpy(&numbers[k], &word, sizeof word);
    }
}

/* A table of integers or numbers (8 bytes each), column by column, each by its differences from row to row. */
static void *columns(struct unpacking *u, int kind, size_t rows, size_t width) {
    /* every number has a code */
    if ((uint64_t)rows * width > (uint64_t)(u->streams[kind].codes_end - u->streams[kind].codes)) {
        u->ended = true;
        return NULL;
    }
    uint64_t *table = calloc(rows * width + 1, sizeof *table);
    for (size_t c = 0; table && c < width; c++) {
        uint64_t word = 0;
        for (size_t r = 0; r < rows; r++) {
            word += next(u, kind);
            table[r * width + c] = kind == INTEGERS ? word : ordered(word);
        }
    }
    return table;
}

/* Bytes of each table of a model whose counts have been looked at. */
static void extents(const int64_t *m, uint64_t *bytes) {
    const uint64_t n = 8 * (uint64_t)m[SIZE], c = (uint64_t)m[CONTACTS], lagged = (uint64_t)m[LAGGED], singles = 4 * (uint64_t)m[SINGLES];
    bytes[OMEGA] = bytes[SIGMA] = n;
    bytes[RESIDUAL] = bytes[MATRIX] = 8 * c * c;
    bytes[SHAPES] = c * n;
    bytes[ROWS_OF] = PREDICT_ROWS * n;
    bytes[WEIGHTS] = 2 * n;
    bytes[LAGS] = 16 * PREDICT_BLOCK * lagged * lagged;
    bytes[OUT_LAGS] = 32 * PREDICT_BLOCK * lagged;
    bytes[SINGLE_ROWS] = PREDICT_ROWS * singles;
    bytes[SINGLE_SHAPES] = c * singles;
    bytes[SINGLE_WEIGHTS] = 2 * singles;
}

static bool makes(const int64_t *m, int table) { return m[MAKES] >> table & 1; }

/* Whether a number lies from 0 to `most`. */
static bool within(int64_t number, uint64_t most) { return number >= 0 && (uint64_t)number <= most; }

static bool check_counts(const struct unpacking *u, size_t row) {
    const int64_t *m = u->models[row];
    if (!within(m[SIZE], MOST_ROWS) || !within(m[MODES], (uint64_t)m[SIZE]) || !within(m[OWN], (uint64_t)m[MODES]) ||
        !within(m[CONTACTS], MOST_ROWS) || !(m[LAGGED] == 0 || m[LAGGED] == m[CONTACTS]) ||
        !(m[SINGLES] == 0 || (m[SINGLES] >= m[SIZE] && m[SINGLES] <= MOST_ROWS)) || !within(m[ON_Q], 2) || !within(m[VELOCITY], 1))
        return false;
    if (m[STRING] < 0 || (uint64_t)m[STRING] >= u->h.strings || !within(m[WEIGHING], SMOOTH) || !within(m[MAKES], (1u << TABLES) - 1))
        return false;
    return m[BASE] == 0 || (m[BASE] > 0 && (uint64_t)m[BASE] < row);
}

/* Steps that predictions of a model take. Counts and places have been looked at: no product is too large for 64 bits. */
static uint64_t steps_of(const struct unpacking *u, const int64_t *m) {
    const uint64_t n = (uint64_t)m[SIZE], c = (uint64_t)m[CONTACTS], lagged = (uint64_t)m[LAGGED];
    uint64_t steps = 0;
    if (makes(m, OMEGA) || makes(m, SIGMA))
        steps += (1 + 2 * (uint64_t)u->string_integers[m[STRING]][NUTS]) * n;
    if (makes(m, WEIGHTS) && m[WEIGHING] == FILTERED)
        steps += (uint64_t)m[TAPS] * n;
    if (makes(m, SHAPES))
        steps += c * n;
    if (makes(m, MATRIX))
        steps += c * c * n;
    if (makes(m, LAGS))
        steps += PREDICT_BLOCK * lagged * lagged * n;
    if (makes(m, OUT_LAGS))
        steps += 2 * PREDICT_BLOCK * lagged * n;
    return steps;
}

/* Whether no more is predicted than the bytes that there are can be meant for. */
static bool check_steps(const struct unpacking *u) {
    uint64_t left = MOST_STEPS * u->h.size;
    for (size_t row = 0; row < u->h.models; row++) {
        const uint64_t steps = steps_of(u, u->models[row]);
        if (steps > left)
            return false;
        left -= steps;
    }
    return true;
}

/* Where the tables of all models lie: what is made behind what was made before it, else from the base's on. */
static bool place_tables(struct unpacking *u) {
    uint64_t at = 0, made = 0;
    for (size_t row = 0; row < u->h.models; row++) {
        int64_t *m = u->models[row];
        uint64_t bytes[TABLES];
        if (!check_counts(u, row))
            return false;
        extents(m, bytes);
        for (int k = 0; k < TABLES; k++) {
            uint64_t place = (uint64_t)m[FIRST_TABLE + k];
            if (makes(m, k))
                place += at;
            else if ((uint64_t)m[BASE] < row)
                place += (uint64_t)u->models[m[BASE]][FIRST_TABLE + k];
            if (place % 8 != 0 || bytes[k] > u->room || place > u->room - bytes[k])
                return false;
            m[FIRST_TABLE + k] = (int64_t)place;
            if (makes(m, k)) {
                at = place + (bytes[k] + 63) / 64 * 64;
                made += bytes[k];
                if (made > u->room)
                    return false;
            }
        }
        if (m[WEIGHING] == FILTERED && makes(m, WEIGHTS) &&
            (u->models[m[BASE]][SIZE] < m[SIZE] || m[TAPS] < 1 || !within(m[TAPS], u->h.taps) ||
             !within(m[FIRST_TAP], u->h.taps - (uint64_t)m[TAPS])))
            return false;
    }
    for (size_t k = 0; k < u->h.strings; k++) {
        const int64_t *s = u->string_integers[k];
        if (!within(s[NUTS], u->h.nuts) || !within(s[FIRST_NUT], u->h.nuts - (uint64_t)s[NUTS]))
            return false;
    }
    return true;
}

/* What is no table that is made. */
static bool put_areas(struct unpacking *u) {
    uint64_t at = 0;
    for (size_t k = 0; k < u->h.areas; k++) {
        const int64_t *area = u->areas[k];
        if (!within(area[GAP], u->room - at))
            return false;
        at += (uint64_t)area[GAP];
        if (!within(area[BYTES], u->room - at))
            return false;
        const size_t size = (size_t)area[BYTES];
        if (area[WORDS] == 0) {
            if (size > (size_t)(u->rest_end - u->rest))
                return false;
            memcpy(u->out + at, u->rest, size);
            u->rest += size;
        } else {
            if (!within(area[WORDS], 64) || size % (8 * (size_t)area[WORDS]) != 0)
                return false;
            void *table = columns(u, INTEGERS, size / (8 * (size_t)area[WORDS]), (size_t)area[WORDS]);
            if (table == NULL)
                return false;
            memcpy(u->out + at, table, size);
            free(table);
        }
        at += size;
    }
    return u->rest == u->rest_end;
}

/* A table of a model in the bank. */
static double *table_of(struct unpacking *u, const int64_t *m, int table) { return (void *)(u->out + m[FIRST_TABLE + table]); }

/* The lower triangle of a matrix, and what mirrors it. */
static void correct_symmetric(struct unpacking *u, int kind, double *matrix, size_t size) {
    for (size_t a = 0; a < size; a++) {
        correct(u, kind, matrix + a * size, a + 1);
        for (size_t b = 0; b < a; b++)
            matrix[b * size + a] = matrix[a * size + b];
    }
}

static void make_frequencies(struct unpacking *u, const int64_t *m, const double *number) {
    const size_t n = (size_t)m[SIZE], own = (size_t)m[OWN];
    double *omega = makes(m, OMEGA) ? table_of(u, m, OMEGA) : NULL, *sigma = makes(m, SIGMA) ? table_of(u, m, SIGMA) : NULL;
    const int64_t *s = u->string_integers[m[STRING]];
    for (size_t j = 0; omega && j < n; j++)
        omega[j] = j < (size_t)m[MODES] ? 0.0 : 1.0;
    if (sigma)
        memset(sigma, 0, 8 * n);
    if (omega || sigma)
        predict_modes(u->strings[m[STRING]], s[LINEAR] != 0, u->nuts + 3 * s[FIRST_NUT], (size_t)s[NUTS], number[RATIO], number[LOSS],
                      own, omega, sigma);
    if (omega)
        correct(u, FIRST_KIND + OMEGA, omega, n);
    if (sigma)
        correct(u, FIRST_KIND + SIGMA, sigma, n);
}

static void make_rows(struct unpacking *u, const int64_t *m, const double *number) {
    const size_t n = (size_t)m[SIZE], modes = (size_t)m[MODES];
    double *rows = table_of(u, m, ROWS_OF);
    const double *omega = table_of(u, m, OMEGA);
    const int kind = FIRST_KIND + ROWS_OF;
    memset(rows, 0, 8 * PREDICT_ROWS * n);
    predict_hold_rows(omega, table_of(u, m, SIGMA), number[MU], number[DT], modes, n, rows);
    correct(u, kind, rows, 2 * n);
    correct(u, kind, rows + 3 * n, 2 * n);
    predict_impulse_rows(omega, number[MU], modes, n, rows);
    correct(u, kind, rows + 2 * n, n);
    correct(u, kind, rows + 5 * n, n);
    predict_later_rows(n, rows);
    correct(u, kind, rows + 6 * n, 8 * n);
}

static void make_weights(struct unpacking *u, const int64_t *m, const double *number) {
    const size_t n = (size_t)m[SIZE];
    double *weights = table_of(u, m, WEIGHTS);
    const int kind = FIRST_KIND + WEIGHTS;
    memset(weights, 0, 16 * n);
    if (m[WEIGHING] == HEARD) {
        for (size_t k = 0; k < 2; k++)
            predict_heard(number[PLACE], u->strings[m[STRING]][0], number[HALF], number[k ? GAIN_V : GAIN_Q], (size_t)m[OWN],
                          weights + k * n);
    } else if (m[WEIGHING] == FILTERED) {
        const int64_t *base = u->models[m[BASE]];
        predict_filtered(table_of(u, m, OMEGA), table_of(u, base, WEIGHTS), (size_t)base[SIZE], u->taps + m[FIRST_TAP], (size_t)m[TAPS],
                         number[RATE], n, weights);
    }
    for (size_t k = 0; k < 2; k++) {
        if (m[WEIGHING] == SMOOTH)
            smooth(u, kind, weights + k * n, n);
        else
            correct(u, kind, weights + k * n, n);
    }
}

static void make_lags(struct unpacking *u, const int64_t *m) {
    const size_t n = (size_t)m[SIZE], c = (size_t)m[LAGGED], length = 2 * PREDICT_BLOCK;
    double *lags = table_of(u, m, LAGS);
    const double *shapes = table_of(u, m, SHAPES), *matrix = table_of(u, m, MATRIX);
    memset(lags, 0, 8 * length * c * c);
    predict_lags(m[VELOCITY] != 0, table_of(u, m, ROWS_OF), shapes, c, shapes, c, 1, n, lags);
    for (size_t p = 0; p < c; p++)
        for (size_t q = 0; q <= p; q++) {
            double *one = lags + (p * c + q) * length;
            one[PREDICT_BLOCK] = matrix[p * c + q];
            correct(u, FIRST_KIND + LAGS, one + PREDICT_BLOCK + 1, PREDICT_BLOCK - 1);
            memmove(lags + (q * c + p) * length, one, 8 * length);
        }
}

static void make_out_lags(struct unpacking *u, const int64_t *m) {
    const size_t n = (size_t)m[SIZE], c = (size_t)m[LAGGED], length = 2 * PREDICT_BLOCK;
    double *lags = table_of(u, m, OUT_LAGS);
    memset(lags, 0, 16 * length * c);
    for (size_t k = 0; k < 2; k++)
        predict_lags(k >= (size_t)m[ON_Q], table_of(u, m, ROWS_OF), table_of(u, m, SHAPES), c, table_of(u, m, WEIGHTS) + k * n, 1, 0, n,
                     lags + k * c * length);
    for (size_t k = 0; k < 2 * c; k++)
        correct(u, FIRST_KIND + OUT_LAGS, lags + k * length + PREDICT_BLOCK, PREDICT_BLOCK);
}

/* Rows of float32, as many as `count`, of those of float64. */
static void make_singles(struct unpacking *u, const int64_t *m, int table, int source, size_t count) {
    const size_t n = (size_t)m[SIZE], singles = (size_t)m[SINGLES];
    const double *from = table_of(u, m, source);
    float *to = (void *)(u->out + m[FIRST_TABLE + table]);
    for (size_t r = 0; r < count; r++) {
        const double less = table == SINGLE_ROWS && (r == 8 || r == 11) ? 1.0 : 0.0;
        for (size_t j = 0; j < singles; j++)
            to[r * singles + j] = j < n ? (float)(from[r * n + j] - less) : 0.0f;
    }
    correct_single(u, FIRST_KIND + table, to, count * singles);
}

/* The tables of a model, from its number of all places on; how many places it took, or −1. */
static int64_t make_tables(struct unpacking *u, const int64_t *m, const double *number, uint64_t place) {
    const size_t n = (size_t)m[SIZE], c = (size_t)m[CONTACTS];
    make_frequencies(u, m, number);
    if (makes(m, RESIDUAL)) {
        memset(table_of(u, m, RESIDUAL), 0, 8 * c * c);
        correct_symmetric(u, FIRST_KIND + RESIDUAL, table_of(u, m, RESIDUAL), c);
    }
    if (makes(m, SHAPES)) {
        if (c > u->h.places - place)
            return -1;
        double *shapes = table_of(u, m, SHAPES);
        memset(shapes, 0, 8 * n * c);
        for (size_t k = 0; k < c; k++)
            predict_shape(u->places[place + k], u->strings[m[STRING]][0], (size_t)m[OWN], shapes + k * n);
        correct(u, FIRST_KIND + SHAPES, shapes, n * c);
    }
    if (makes(m, ROWS_OF))
        make_rows(u, m, number);
    if (makes(m, WEIGHTS))
        make_weights(u, m, number);
    if (makes(m, MATRIX)) {
        double *matrix = table_of(u, m, MATRIX);
        predict_matrix(table_of(u, m, ROWS_OF) + (m[VELOCITY] ? 5 : 4) * n, table_of(u, m, SHAPES), table_of(u, m, RESIDUAL), c, n, matrix);
        correct_symmetric(u, FIRST_KIND + MATRIX, matrix, c);
    }
    if (makes(m, LAGS))
        make_lags(u, m);
    if (makes(m, OUT_LAGS))
        make_out_lags(u, m);
    if (makes(m, SINGLE_ROWS))
        make_singles(u, m, SINGLE_ROWS, ROWS_OF, PREDICT_ROWS);
    if (makes(m, SINGLE_SHAPES))
        make_singles(u, m, SINGLE_SHAPES, SHAPES, c);
    if (makes(m, SINGLE_WEIGHTS))
        make_singles(u, m, SINGLE_WEIGHTS, WEIGHTS, 2);
    return makes(m, SHAPES) ? (int64_t)c : 0;
}

static bool read_header(const void *packed, size_t size, struct packed_header *h) {
    if (packed == NULL || size < sizeof *h)
        return false;
    memcpy(h, packed, sizeof *h);
    return memcmp(h->magic, "JAWARIPK", sizeof h->magic) == 0;
}

int64_t jawari_unpacked_size(const void *packed, size_t size) {
    struct packed_header h;
    return read_header(packed, size, &h) && h.unpacked <= MOST_UNPACKED ? (int64_t)h.unpacked : -1;
}

/* Where streams and rest lie. */
static bool find_streams(struct unpacking *u, const uint8_t *at, const uint8_t *end) {
    for (int k = 0; k < KINDS; k++) {
        const uint64_t codes = u->h.streams[k][0], more = u->h.streams[k][1];
        if (codes > (uint64_t)(end - at) || more > (uint64_t)(end - at) - codes)
            return false;
        u->streams[k] = (struct stream){at, at + codes, at + codes, at + codes + more};
        at += codes + more;
    }
    u->rest = at;
    u->rest_end = end;
    return u->h.rest == (uint64_t)(end - at);
}

static bool all_read(const struct unpacking *u) {
    for (int k = 0; k < KINDS; k++)
        if (u->streams[k].codes != u->streams[k].codes_end || u->streams[k].more != u->streams[k].more_end)
            return false;
    return !u->ended;
}

/* Everything into the room, which holds zeros; the header has been looked at. */
static int unpack(struct unpacking *u, char *why) {
    int number = 0;
    for (int first = 0; first < 8; first++)
        for (int count = 1; count < 9 - first; count++, number++) {
            u->first[number] = (uint8_t)first;
            u->count[number] = (uint8_t)count;
        }
    u->models = columns(u, INTEGERS, u->h.models, MODEL);
    u->numbers = columns(u, FLOATS, u->h.models, NUMBERS);
    u->string_integers = columns(u, INTEGERS, u->h.strings, STRING_INTEGERS);
    u->strings = columns(u, FLOATS, u->h.strings, PREDICT_STRING);
    u->nuts = columns(u, FLOATS, u->h.nuts, 3);
    u->taps = columns(u, FLOATS, u->h.taps, 1);
    u->places = columns(u, FLOATS, u->h.places, 1);
    u->areas = columns(u, INTEGERS, u->h.areas, AREA);
    if (u->ended)
        return refuse(why, "a table in it was cut off");
    if (!u->models || !u->numbers || !u->string_integers || !u->strings || !u->nuts || !u->taps || !u->places || !u->areas)
        return refuse(why, "there is no memory for it");
    if (!place_tables(u))
        return refuse(why, "a table lies outside of it");
    if (!check_steps(u))
        return refuse(why, "its tables are larger than so few bytes can say");
    if (!put_areas(u))
        return refuse(why, "a part lies outside of it");
    uint64_t place = 0;
    for (size_t row = 0; row < u->h.models; row++) {
        const int64_t taken = make_tables(u, u->models[row], u->numbers[row], place);
        if (taken < 0 || u->ended)
            return refuse(why, "a table in it was cut off");
        place += (uint64_t)taken;
    }
    if (!all_read(u))
        return refuse(why, "there is more in it than belongs there");
    if (crc32_of(0, u->out, (size_t)u->room) != u->h.checksum)
        return refuse(why, "it was changed (its checksum is wrong)");
    return 0;
}

int jawari_unpack(const void *packed, size_t size, void *out, size_t room, char *why) {
    struct unpacking u = {0};
    if (!read_header(packed, size, &u.h))
        return refuse(why, "it does not begin like one");
    if (u.h.version != VERSION) {
        if (why)
            snprintf(why, JAWARI_WHY, "the packed bank is of version %u, this library reads %u; export it again with a program of this version",
                     (unsigned)u.h.version, (unsigned)VERSION);
        return -1;
    }
    if (u.h.size != size || u.h.unpacked > MOST_UNPACKED)
        return refuse(why, "it was cut off");
    if (out == NULL || room != u.h.unpacked || (uintptr_t)out % 8 != 0)
        return refuse(why, "the room for it is not of its size, or not on a border of eight bytes");
    if (!find_streams(&u, (const uint8_t *)packed + sizeof u.h, (const uint8_t *)packed + size))
        return refuse(why, "a part lies outside of it");
    u.out = out;
    u.room = room;
    memset(out, 0, room);
    const int result = unpack(&u, why);
    void *held[] = {u.models, u.numbers, u.string_integers, u.strings, u.nuts, u.taps, u.places, u.areas};
    for (size_t k = 0; k < sizeof held / sizeof *held; k++)
        free(held[k]);
    return result;
}
