/* Whether an engine can go on from a state: each number of it lies within the limits that the bank has for it, which are those
 * that the engine in Python looks at (engine/state_limits.py; written by limits.py). */
#include <math.h>
#include <string.h>
#include "core.h"

/* Whether `count` words of `size` bytes, `stride` apart, lie in what a state holds. */
static bool in_state(const struct bank_rate *r, uint32_t at, uint32_t stride, uint32_t count, uint32_t size) {
    const uint64_t all = r->sounding_end - r->sounding;
    return count > 0 && at % size == 0 && stride % size == 0 && at < all && (uint64_t)stride * (count - 1) + size <= all - at;
}

/* The same of words that a limit's words are looked at with; none is fine. */
static bool beside(const struct bank_rate *r, const struct bank_limit *x, uint32_t at, uint32_t stride) {
    return at == LIMIT_NONE || in_state(r, at, stride, x->count, 8);
}

bool core_limits_fit(const struct bank_rate *r, const uint8_t *block) {
    const struct bank_limit *limits = (const void *)(block + r->limits_at);
    const struct bank_condition *conditions = (const void *)(block + r->conditions_at);
    const struct bank_name *names = (const void *)(block + r->names_at);
    for (uint64_t k = 0; k < r->names; k++)
        if (memchr(names[k].name, 0, sizeof names[k].name) == NULL)
            return false;
    for (uint64_t k = 0; k < r->limits; k++) {
        const struct bank_limit *x = &limits[k];
        if (x->kind >= LIMIT_KINDS || x->name >= r->names || x->multiple < 1 || x->condition > r->conditions ||
            x->conditions > r->conditions - x->condition)
            return false;
        if (!in_state(r, x->at, x->stride, x->count, x->kind == LIMIT_BYTE ? 1 : 8) || !beside(r, x, x->above, x->above_stride) ||
            !beside(r, x, x->below, x->below_stride) || (x->counted != LIMIT_NONE && !in_state(r, x->counted, 0, 1, 8)))
            return false;
        for (uint32_t c = x->condition; c < x->condition + x->conditions; c++)
            if (!in_state(r, conditions[c].at, conditions[c].stride, x->count, 8))
                return false;
    }
    const struct bank_ahead *a = &r->ahead;
    if (a->window == 0)
        return true;
    return a->frames > 0 && a->channels > 0 && a->channels < 256 && a->frames < 1 << 20 && a->window < 1 << 20 &&
           a->ceiling > 0.0 && in_state(r, a->delay, 8, a->frames * a->channels, 8) && in_state(r, a->required, 8, a->window, 8) &&
           in_state(r, a->counters, 8, 3, 8);
}

static int64_t word(const uint8_t *state, uint64_t at) {
    int64_t value;
    memcpy(&value, state + at, sizeof value);
    return value;
}

static double number(const uint8_t *state, uint64_t at) {
    double value;
    memcpy(&value, state + at, sizeof value);
    return value;
}

static double as_number(int64_t bits) {
    double value;
    memcpy(&value, &bits, sizeof value);
    return value;
}

static bool concerned(const struct bank_condition *conditions, uint32_t count, const uint8_t *state, uint32_t k) {
    for (uint32_t c = 0; c < count; c++) {
        const int64_t value = word(state, conditions[c].at + (uint64_t)conditions[c].stride * k);
        if (value < conditions[c].low || value > conditions[c].high)
            return false;
    }
    return true;
}

/* Whether word k is between the bounds; these and the value, to be told. */
static bool number_within(const struct bank_limit *x, const uint8_t *state, uint32_t k, double told[3]) {
    told[0] = as_number(x->low);
    told[1] = as_number(x->high);
    told[2] = number(state, x->at + (uint64_t)x->stride * k);
    if (x->above != LIMIT_NONE)
        told[0] += number(state, x->above + (uint64_t)x->above_stride * k);
    if (x->below != LIMIT_NONE)
        told[1] += number(state, x->below + (uint64_t)x->below_stride * k);
    return told[2] >= told[0] && told[2] <= told[1]; /* what is no number is not */
}

static bool integer_within(const struct bank_limit *x, const uint8_t *state, uint32_t k, double told[3]) {
    int64_t low = x->low, high = x->high;
    const uint64_t at = x->at + (uint64_t)x->stride * k;
    const int64_t value = x->kind == LIMIT_BYTE ? state[at] : word(state, at);
    bool sound = true;
    if (x->above != LIMIT_NONE)
        sound = !__builtin_add_overflow(low, word(state, x->above + (uint64_t)x->above_stride * k), &low);
    if (x->below != LIMIT_NONE)
        sound = !__builtin_add_overflow(high, word(state, x->below + (uint64_t)x->below_stride * k), &high) && sound;
    told[0] = (double)low;
    told[1] = (double)high;
    told[2] = (double)value;
    return sound && value >= low && value <= high && value % (int64_t)x->multiple == 0;
}

/* `dsp.limiter.limiter_problem`: what is to leave and above the ceiling has its reduction. Frame k from now leaves from the delay
 * at place + k; it came as many frames ago as the delay is long, less k, and so did its reduction. */
static bool reduced_in_time(const struct bank_ahead *a, const uint8_t *state) {
    const uint64_t place = (uint64_t)word(state, a->counters), ring = (uint64_t)word(state, a->counters + 8);
    const int64_t active = word(state, a->counters + 16);
    for (uint64_t k = 0; k < a->frames; k++) {
        bool over = false;
        for (uint64_t c = 0; c < a->channels; c++)
            over = over || !(fabs(number(state, a->delay + 8 * ((place + k) % a->frames * a->channels + c))) <= a->ceiling);
        if (over && (active < (int64_t)a->window || !(number(state, a->required + 8 * ((ring + 1 + k) % a->window)) > 0.0)))
            return false;
    }
    return true;
}

bool core_within_limits(const struct bank_rate *r, const uint8_t *block, const uint8_t *state, char *why) {
    const struct bank_limit *limits = (const void *)(block + r->limits_at);
    const struct bank_condition *conditions = (const void *)(block + r->conditions_at);
    const struct bank_name *names = (const void *)(block + r->names_at);
    double told[3];
    for (uint64_t k = 0; k < r->limits; k++) {
        const struct bank_limit *x = &limits[k];
        uint32_t count = x->count;
        if (x->counted != LIMIT_NONE) {
            const int64_t there = word(state, x->counted);
            count = there <= x->skip ? 0 : there - x->skip < count ? (uint32_t)(there - x->skip) : count;
        }
        for (uint32_t i = 0; i < count; i++) {
            if (x->conditions > 0 && !concerned(conditions + x->condition, x->conditions, state, i))
                continue;
            if (x->kind == LIMIT_NUMBER ? number_within(x, state, i, told) : integer_within(x, state, i, told))
                continue;
            core_say(why, "%s must lie between %.17g and %.17g%s, got %.17g", names[x->name].name, told[0], told[1],
                     x->multiple > 1 ? " in whole quanta" : "", told[2]);
            return false;
        }
    }
    if (r->ahead.window > 0 && !reduced_in_time(&r->ahead, state)) {
        core_say(why, "the limiter's delay line holds samples above its ceiling without a reduction for them");
        return false;
    }
    return true;
}
