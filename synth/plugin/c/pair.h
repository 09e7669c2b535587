/* pair.h: sums and products of doubles with what rounding took off them (Dekker, Numerische Mathematik 18, 1971). To be compiled
 * without contraction. */
#ifndef JAWARI_PAIR_H
#define JAWARI_PAIR_H

/* A number and what rounding took off it. */
struct pair {
    double high, low;
};

static inline struct pair two_sum(double a, double b) {
    const double s = a + b, t = s - a;
    return (struct pair){s, (a - (s - t)) + (b - t)};
}

static inline struct pair two_product(double a, double b) {
    const double split = 134217729.0; /* 2^27 + 1 */
    const double p = a * b;
    double t = split * a;
    const double ah = t - (t - a), al = a - ah;
    t = split * b;
    const double bh = t - (t - b), bl = b - bh;
    return (struct pair){p, ((ah * bh - p) + ah * bl + al * bh) + al * bl};
}

#endif
