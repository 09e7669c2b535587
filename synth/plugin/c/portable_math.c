/* Elementary functions that give the same bits everywhere: + − × ÷ of doubles only, of which each rounds (-ffp-contract=off).
 *
 * They are those that portable kernels call in the place of a system's (one_rounding.py), and are within two units in the last
 * place of the true value: arguments are reduced with constants in parts whose products are exact (Cody and Waite, Software
 * Manual for the Elementary Functions, 1980), and the rest is Taylor's series, with coefficients as they are defined. pow takes
 * its logarithm with twice the digits (pair.h).
 */
#include <math.h>
#include <stdint.h>
#include <string.h>
#include "pair.h"

#define HIDDEN __attribute__((visibility("hidden")))
HIDDEN double jawari_exp(double x);
HIDDEN double jawari_exp2(double x);
HIDDEN double jawari_expm1(double x);
HIDDEN double jawari_log2(double x);
HIDDEN double jawari_pow(double x, double y);
HIDDEN double jawari_sin(double x);
HIDDEN double jawari_cos(double x);

/* ln 2: of 32 bits, and the rest; 1 / ln 2 as a double, and the rest */
static const double LN2_HIGH = 0x1.62e42feep-1, LN2_LOW = 1.9082149292705877e-10;
static const double LN2 = 0.6931471805599453, LN2_REST = 2.3190468138462996e-17;
static const double PER_LN2 = 1.4426950408889634, PER_LN2_REST = 2.0355273740931033e-17;
/* π/2 in parts of 33 bits, and the rest; 2 / π */
static const double QUARTER[] = {0x1.921fb544p+0, 0x1.0b4611a6p-34, 0x1.3198a2ep-69, 8.4784276603689e-32};
static const double PER_QUARTER = 0.6366197723675814;
/* larger ones have no bits left to be reduced to */
static const double LARGEST_ANGLE = 0x1p40;

static uint64_t bits_of(double x) {
    uint64_t bits;
    memcpy(&bits, &x, sizeof bits);
    return bits;
}

static double of_bits(uint64_t bits) {
    double x;
    memcpy(&x, &bits, sizeof x);
    return x;
}

/* To the nearest whole number, half to even: for |x| < 2^51. */
static double nearest(double x) {
    const double shift = 0x1.8p52;
    return x + shift - shift;
}

/* x·2^k; |k| ≤ 2100. */
static double scaled(double x, int k) {
    while (k > 1000) {
        x *= 0x1p1000;
        k -= 1000;
    }
    while (k < -900) { /* at once where the result is subnormal: it rounds a single time */
        if (k >= -1074 && fabs(x) < 4.0)
            return x * of_bits((uint64_t)(k + 1100 + 1023) << 52) * 0x1p-1000 * 0x1p-100;
        x *= 0x1p-900;
        k += 900;
    }
    return x * of_bits((uint64_t)(k + 1023) << 52);
}

/* Σ r^n / (n + 2)!, n = 0 … 12: exp r = 1 + r + r²·this, for |r| ≤ ln 2 / 2. */
static double tail_of_exp(double r) {
    static const double c[] = {1.0 / 2,        1.0 / 6,         1.0 / 24,         1.0 / 120,       1.0 / 720,
                               1.0 / 5040,     1.0 / 40320,     1.0 / 362880,     1.0 / 3628800,   1.0 / 39916800,
                               1.0 / 479001600, 1.0 / 6227020800, 1.0 / 87178291200};
    double sum = 0.0;
    for (int n = (int)(sizeof c / sizeof *c) - 1; n >= 0; n--)
        sum = sum * r + c[n];
    return sum;
}

/* exp(high + low)·2^k for |high + low| ≤ ln 2 / 2, and low small. */
static double exp_of_rest(double high, double low, int k) {
    return scaled(1.0 + (high + (low + high * high * tail_of_exp(high))), k);
}

/* exp(high + low), low below the last place of high. */
static double exp_of_sum(double high, double low) {
    if (high > 709.9)
        return INFINITY;
    if (high < -745.2)
        return 0.0;
    const double k = nearest(high * PER_LN2);
    const double first = high - k * LN2_HIGH, second = low - k * LN2_LOW, rest = first + second;
    return exp_of_rest(rest, first - rest + second, (int)k);
}

double jawari_exp(double x) { return x != x ? x : exp_of_sum(x, 0.0); }

double jawari_exp2(double x) {
    if (x != x)
        return x;
    if (x >= 1024.0)
        return INFINITY;
    if (x < -1075.0)
        return 0.0;
    const double k = nearest(x), f = x - k, rest = f * LN2;
    return exp_of_rest(rest, f * LN2_REST, (int)k);
}

double jawari_expm1(double x) {
    if (x != x || x > 709.9)
        return x != x ? x : INFINITY;
    if (x < -40.0)
        return -1.0;
    const double k = nearest(x * PER_LN2);
    const double first = x - k * LN2_HIGH, second = k * LN2_LOW, rest = first - second;
    const double low = first - rest - second;
    const double less_one = rest + (low + rest * rest * tail_of_exp(rest));
    if (k == 0.0)
        return less_one;
    if (k > 60.0)
        return exp_of_sum(x, 0.0);
    const double power = scaled(1.0, (int)k);
    return (power - 1.0) + power * less_one; /* power − 1 is exact up to 2^53, and beyond it the rest is below */
}

/* x = (1 + f)·2^k with √½ ≤ 1 + f < √2, for x > 0 and finite. */
static double parted(double x, int *k) {
    int shift = 0;
    if (x < 0x1p-1022) {
        x *= 0x1p54;
        shift = -54;
    }
    const uint64_t bits = bits_of(x);
    int power = (int)(bits >> 52) - 1023;
    double m = of_bits((bits & 0xfffffffffffffu) | (uint64_t)1023 << 52);
    if (m > 1.4142135623730951) {
        m *= 0.5;
        power++;
    }
    *k = power + shift;
    return m - 1.0;
}

/* ln(1 + f) as a sum of two doubles: 2 artanh s, s = f / (2 + f). */
static double log_of(double f, double *low) {
    const double d = 2.0 + f, d_low = f - (d - 2.0), s = f / d;
    const struct pair p = two_product(s, d);
    const double s_low = (f - p.high - p.low - s * d_low) / d, z = s * s;
    double sum = 0.0;
    for (int n = 12; n >= 1; n--)
        sum = sum * z + 1.0 / (2 * n + 1);
    const double rest = 2.0 * s_low + 2.0 * s * z * sum, high = 2.0 * s + rest;
    *low = 2.0 * s - high + rest;
    return high;
}

double jawari_log2(double x) {
    if (x != x || x < 0.0)
        return x != x ? x : NAN;
    if (x == 0.0)
        return -INFINITY;
    if (x > 1.7976931348623157e308)
        return x;
    int k;
    double low;
    const double f = parted(x, &k), high = log_of(f, &low), whole = (double)k;
    const struct pair p = two_product(high, PER_LN2);
    const double rest = p.low + (low * PER_LN2 + high * PER_LN2_REST), sum = whole + p.high;
    /* |whole| > |p|, or there is no whole */
    return whole == 0.0 ? p.high + rest : sum + (whole - sum + p.high + rest);
}

/* Whether a number is whole (1) and odd (2). */
static int wholeness(double y) {
    if (fabs(y) >= 0x1p53)
        return 1;
    const double whole = (double)(int64_t)y;
    return whole != y ? 0 : (int64_t)y & 1 ? 2 : 1;
}

double jawari_pow(double x, double y) {
    if (y == 0.0 || x == 1.0)
        return 1.0;
    if (x != x || y != y)
        return x + y;
    const int whole = wholeness(y);
    const double sign = (bits_of(x) >> 63) && whole == 2 ? -1.0 : 1.0, size = fabs(x);
    if (fabs(y) > 1.7976931348623157e308)
        return size == 1.0 ? 1.0 : (size > 1.0) == (y > 0.0) ? INFINITY : 0.0;
    if (size == 0.0 || size > 1.7976931348623157e308)
        return sign * ((size == 0.0) == (y > 0.0) ? 0.0 : INFINITY);
    if (x < 0.0 && whole == 0)
        return NAN;
    int k;
    double low;
    const double f = parted(size, &k), part = log_of(f, &low), whole_k = (double)k;
    /* ln size = k ln 2 + ln(1 + f): k·LN2_HIGH is exact, and larger than the rest where there is one */
    const double first = whole_k * LN2_HIGH, second = whole_k * LN2_LOW;
    const double sum = first + part, lost = first == 0.0 ? 0.0 : first - sum + part;
    const double rest = lost + (second + low), high = sum + rest, high_low = sum - high + rest;
    if (fabs(y) > 1e300 || fabs(high) * fabs(y) > 800.0)
        return sign * ((high > 0.0) == (y > 0.0) ? INFINITY : 0.0);
    const struct pair p = two_product(high, y);
    return sign * exp_of_sum(p.high, p.low + high_low * y);
}

/* x − k·π/2 as a sum of two doubles, |sum| ≤ π/4, and k's last two bits; for |x| < LARGEST_ANGLE. */
static double reduced(double x, double *low, int *quadrant) {
    const double k = nearest(x * PER_QUARTER);
    /* parts of 20 bits: their products with parts of 33 are exact */
    const double upper = nearest(k * 0x1p-20) * 0x1p20, lower = k - upper;
    double high = x, rest = 0.0;
    for (int n = 0; n < 4; n++) {
        const double parts[] = {upper * QUARTER[n], lower * QUARTER[n]};
        for (int m = 0; m < 2; m++) {
            const double difference = high - parts[m], back = difference - high;
            rest += high - (difference - back) + (-parts[m] - back);
            high = difference;
        }
    }
    const double sum = high + rest;
    *low = high - sum + rest;
    *quadrant = (int)((int64_t)k & 3);
    return sum;
}

static double sine_of_rest(double r, double low) {
    static const double c[] = {-1.0 / 6,       1.0 / 120,         -1.0 / 5040,          1.0 / 362880,
                               -1.0 / 39916800, 1.0 / 6227020800, -1.0 / 1307674368000, 1.0 / 355687428096000};
    const double z = r * r;
    double sum = 0.0;
    for (int n = (int)(sizeof c / sizeof *c) - 1; n >= 0; n--)
        sum = sum * z + c[n];
    return r + (low * (1.0 - 0.5 * z) + r * z * sum);
}

static double cosine_of_rest(double r, double low) {
    static const double c[] = {1.0 / 24,       -1.0 / 720,        1.0 / 40320,          -1.0 / 3628800,
                               1.0 / 479001600, -1.0 / 87178291200, 1.0 / 20922789888000, -1.0 / 6402373705728000};
    const double z = r * r, half = 0.5 * z, first = 1.0 - half;
    double sum = 0.0;
    for (int n = (int)(sizeof c / sizeof *c) - 1; n >= 0; n--)
        sum = sum * z + c[n];
    return first + ((1.0 - first - half) + (z * z * sum - r * low));
}

static double turned(double x, int ahead) {
    if (!(fabs(x) < LARGEST_ANGLE))
        return NAN;
    int quadrant;
    double low;
    const double r = reduced(x, &low, &quadrant);
    quadrant = (quadrant + ahead) & 3;
    const double value = quadrant & 1 ? cosine_of_rest(r, low) : sine_of_rest(r, low);
    return quadrant & 2 ? -value : value;
}

double jawari_sin(double x) { return x == 0.0 ? x : turned(x, 0); }
double jawari_cos(double x) { return turned(x, 1); }
