#include "bank_predict.h"
#include <math.h>
#include "pair.h"

/* π and, as fdlibm has it, π/2 in parts */
#define PI 3.141592653589793
#define H0 1.57079632673412561417e00
#define H1 6.07710050630396597660e-11
#define H2 2.02226624871116645580e-21
#define H3 8.47842766036889956997e-32
#define L0 6.93147180369123816490e-01
#define L1 1.90821492927058770002e-10
#define SIXTH (1.0 / 6.0)
#define SIXTH_LOW 9.25185853854297065662e-18
#define PER_24 (1.0 / 24.0)
#define PER_24_LOW 2.3129646346357426e-18

static inline double multiplied_and_added(double a, double b, double c) {
    const struct pair p = two_product(a, b), s = two_sum(p.high, c);
    return s.high + (s.low + p.low);
}

static struct pair reduced(double x, int *quarter) {
    *quarter = 0;
    if (!(fabs(x) < 1e6))
        return (struct pair){0.0, 0.0};
    const double k = floor(x * 0.6366197723675814 + 0.5), p0 = x - k * H0;
    const struct pair b = two_product(k, H1), first = two_sum(p0, -b.high);
    const double low = first.low - b.low, c = k * H2;
    const struct pair sure = two_sum(first.high, low), more = two_sum(sure.high, -c);
    const double rest = (sure.low + more.low) - k * H3;
    *quarter = (int)k & 3;
    return two_sum(more.high, rest);
}

static double sine_near_0(double r, double low) {
    const struct pair z = two_product(r, r);
    struct pair cube = two_product(z.high, r);
    cube.low = cube.low + z.low * r;
    struct pair t = two_product(cube.high, SIXTH);
    t.low = t.low + (cube.low * SIXTH + cube.high * SIXTH_LOW);
    double q = -7.647163731819816e-13;
    q = q * z.high + 1.6059043836821613e-10;
    q = q * z.high - 2.505210838544172e-08;
    q = q * z.high + 2.7557319223985893e-06;
    q = q * z.high - 1.984126984126984e-04;
    q = q * z.high + 8.333333333333333e-03;
    const struct pair s = two_sum(r, -t.high);
    return s.high + ((s.low - t.low) + (cube.high * z.high * q + low * (1.0 - 0.5 * z.high)));
}

static double cosine_near_0(double r, double low) {
    const struct pair z = two_product(r, r);
    double q = 4.779477332387385e-14;
    q = q * z.high - 1.1470745597729725e-11;
    q = q * z.high + 2.08767569878681e-09;
    q = q * z.high - 2.755731922398589e-07;
    q = q * z.high + 2.48015873015873e-05;
    q = q * z.high - 1.388888888888889e-03;
    struct pair fourth = two_product(z.high, z.high);
    fourth.low = fourth.low + 2.0 * z.high * z.low;
    struct pair t = two_product(fourth.high, PER_24);
    t.low = t.low + (fourth.low * PER_24 + fourth.high * PER_24_LOW);
    const struct pair s = two_sum(1.0, -0.5 * z.high), more = two_sum(s.high, t.high);
    return more.high + ((s.low + more.low) + (t.low - 0.5 * z.low + fourth.high * z.high * q - r * low));
}

static double sine(double x) {
    int k;
    const struct pair r = reduced(x, &k);
    const double y = k & 1 ? cosine_near_0(r.high, r.low) : sine_near_0(r.high, r.low);
    return k & 2 ? -y : y;
}

static double cosine(double x) {
    int k;
    const struct pair r = reduced(x, &k);
    const double y = k & 1 ? sine_near_0(r.high, r.low) : cosine_near_0(r.high, r.low);
    return (k + 1) & 2 ? -y : y;
}

static struct pair exponential_less_1(double x) {
    if (!(-700.0 <= x && x <= 0.0))
        return (struct pair){-1.0, 0.0};
    const double k = floor(x * 1.4426950408889634 + 0.5), a = x - k * L0, b = k * L1;
    const struct pair r = two_sum(a, -b), z = two_product(r.high, r.high);
    double q = 1.6059043836821613e-10;
    q = q * r.high + 2.08767569878681e-09;
    q = q * r.high + 2.505210838544172e-08;
    q = q * r.high + 2.755731922398589e-07;
    q = q * r.high + 2.7557319223985893e-06;
    q = q * r.high + 2.48015873015873e-05;
    q = q * r.high + 1.984126984126984e-04;
    q = q * r.high + 1.388888888888889e-03;
    q = q * r.high + 8.333333333333333e-03;
    q = q * r.high + 4.1666666666666664e-02;
    struct pair cube = two_product(z.high, r.high);
    cube.low = cube.low + z.low * r.high;
    struct pair t = two_product(cube.high, SIXTH);
    t.low = t.low + (cube.low * SIXTH + cube.high * SIXTH_LOW);
    const struct pair first = two_sum(r.high, 0.5 * z.high), s = two_sum(first.high, t.high);
    const double rest = (first.low + s.low) + (t.low + 0.5 * z.low + cube.high * r.high * q + r.low * (1.0 + r.high));
    if (k == 0.0)
        return (struct pair){s.high, rest};
    double scale = 1.0;
    for (int i = (int)-k; i > 0; i--)
        scale = scale * 0.5;
    const struct pair e = two_sum(1.0, s.high);
    const double whole = e.high * scale, low = (e.low + rest) * scale;
    const struct pair less = two_sum(whole, -1.0);
    return (struct pair){less.high, less.low + low};
}

struct held {
    double y, impulse, p11, p22;
};

static struct held hold(double omega, double sigma, double dt) {
    if ((omega + 2.0 * sigma) * dt < 0.25) {
        double y = 0.5 * dt * dt, yp = dt, t0 = 0.0, t1 = 0.5 * dt * dt;
        for (int i = 1; i < 16; i++) {
            const double k = i, t2 = -(2.0 * sigma * dt * (k + 1.0) * t1 + omega * omega * dt * dt * t0) / ((k + 1.0) * (k + 2.0));
            y = y + t2;
            yp = yp + (k + 2.0) * t2 / dt;
            t0 = t1;
            t1 = t2;
        }
        const double p11 = 1.0 - omega * omega * y;
        return (struct held){y, yp, p11, p11 - 2.0 * sigma * yp};
    }
    const double d2 = (omega - sigma) * (omega + sigma);
    if (d2 * dt * dt < 1e-4)
        return (struct held){0.0, 0.0, 0.0, 0.0};
    const struct pair less = exponential_less_1(-sigma * dt), one = two_sum(1.0, less.high);
    const double decay = one.high + (one.low + less.low), lost = less.high + less.low, wd = sqrt(d2);
    const double s = decay * sine(wd * dt) / wd, c = decay * cosine(wd * dt), half = sine(0.5 * wd * dt);
    const double y = (-lost + 2.0 * decay * half * half - sigma * s) / (omega * omega);
    return (struct held){y, s, c + sigma * s, c - sigma * s};
}

static double cubed(double x) {
    const struct pair z = two_product(x, x), cube = two_product(z.high, x);
    return cube.high + (cube.low + z.low * x);
}

/* The real part and, as `low`, the imaginary one. */
static struct pair quotient(double omega, double own, double mass, double q) {
    const double real = mass * (own * own - omega * omega), imaginary = mass * (omega * own / q);
    if (fabs(real) >= fabs(imaginary)) {
        const double ratio = imaginary / real, scale = 1.0 / (real + imaginary * ratio);
        return (struct pair){omega * ratio * scale, omega * scale};
    }
    const double ratio = real / imaginary, scale = 1.0 / (imaginary + real * ratio);
    return (struct pair){omega * scale, omega * ratio * scale};
}

void predict_modes(const double *string, int linear, const double *nut, size_t nuts, double ratio, double loss, size_t own,
                   double *omega, double *sigma) {
    const double length = string[0], tension = string[1], mu = string[2], bending = string[3], viscoelastic = string[4];
    const double thermoelastic = string[5], viscosity = string[6], density = string[7], diameter = string[8];
    const double lowest = sqrt(tension / mu) / (2.0 * length), stiffening = PI * PI * bending / (tension * (length * length));
    const double impedance = sqrt(tension * mu);
    for (size_t i = 0; i < own; i++) {
        const double j = (double)i + 1.0, more = stiffening * (j * j);
        const double stiff = linear ? 1.0 + 0.5 * more : sqrt(1.0 + more), omega_0 = 2.0 * PI * lowest * j;
        double real = 0.0, imaginary = 0.0;
        for (size_t k = 0; k < nuts; k++)
            imaginary = imaginary + quotient(omega_0, 2.0 * PI * nut[3 * k], nut[3 * k + 2], nut[3 * k + 1]).low;
        const double w = omega_0 * (stiff + -impedance / (PI * j) * imaginary);
        if (omega)
            omega[i] = ratio * w;
        if (!sigma)
            continue;
        for (size_t k = 0; k < nuts; k++)
            real = real + quotient(w, 2.0 * PI * nut[3 * k], nut[3 * k + 2], nut[3 * k + 1]).high;
        const double nu = w / (2.0 * PI), nu_0 = lowest * j;
        const double drag = 2.0 * PI * (viscosity + diameter * sqrt(PI * viscosity * density * nu));
        const double air = nu_0 / nu * drag / (2.0 * PI * mu * nu);
        const double inner = 4.0 * (PI * PI) * mu * (bending * viscoelastic) / (tension * tension) * cubed(nu_0) / nu;
        const double at_nut = tension / (PI * length * nu) * real;
        sigma[i] = loss * (PI * nu * (air + inner + thermoelastic + at_nut));
    }
}

void predict_shape(double x, double length, size_t own, double *out) {
    const double scale = sqrt(2.0 / length), per = PI / length;
    for (size_t i = 0; i < own; i++)
        out[i] = scale * sine(x * (((double)i + 1.0) * per));
}

void predict_heard(double x, double length, double half, double gain, size_t own, double *out) {
    predict_shape(x, length, own, out);
    for (size_t i = 0; i < own; i++) {
        double seen = out[i];
        if (half > 0.0) {
            const double angle = PI * (((double)i + 1.0) / length * half);
            seen = seen * (sine(angle) / angle);
        }
        out[i] = gain * seen;
    }
}

void predict_filtered(const double *omega, const double *weights, size_t weights_n, const double *taps, size_t count, double rate,
                      size_t n, double *out) {
    for (size_t i = 0; i < n; i++) {
        const double c = cosine(2.0 * PI * (omega[i] / (2.0 * PI)) / rate);
        double later = 0.0, after = 0.0;
        for (size_t k = count - 1; k > 0; k--) {
            const double now = taps[k] + 2.0 * c * later - after;
            after = later;
            later = now;
        }
        const double gain = taps[0] + 2.0 * (c * later - after);
        out[i] = weights[i] * gain;
        out[n + i] = weights[weights_n + i] * gain;
    }
}

void predict_hold_rows(const double *omega, const double *sigma, double mu, double dt, size_t modes, size_t n, double *rows) {
    for (size_t j = 0; j < modes; j++) {
        const struct held one = hold(omega[j], sigma[j], dt);
        rows[j] = one.p11;
        rows[n + j] = one.impulse;
        rows[3 * n + j] = one.p22;
        rows[4 * n + j] = one.y / mu;
    }
}

void predict_impulse_rows(const double *omega, double mu, size_t modes, size_t n, double *rows) {
    const double *impulse = rows + n;
    for (size_t j = 0; j < modes; j++) {
        rows[2 * n + j] = -omega[j] * omega[j] * impulse[j];
        rows[5 * n + j] = impulse[j] / mu;
    }
}

void predict_later_rows(size_t n, double *rows) {
    for (size_t j = 0; j < n; j++) {
        double a = rows[j], b = rows[n + j], c = rows[2 * n + j], d = rows[3 * n + j];
        const double kq = rows[4 * n + j], kv = rows[5 * n + j];
        rows[6 * n + j] = a + d;
        rows[7 * n + j] = multiplied_and_added(-a, d, b * c);
        rows[12 * n + j] = multiplied_and_added(b, kv, -(d * kq));
        rows[13 * n + j] = multiplied_and_added(c, kq, -(a * kv));
        for (int i = 0; i < 3; i++) {
            const double cross = b * c, trace = a + d;
            a = multiplied_and_added(a, a, cross);
            d = multiplied_and_added(d, d, cross);
            b = b * trace;
            c = c * trace;
        }
        rows[8 * n + j] = a;
        rows[9 * n + j] = b;
        rows[10 * n + j] = c;
        rows[11 * n + j] = d;
    }
}

void predict_matrix(const double *gain, const double *shapes, const double *residual, size_t contacts, size_t n, double *out) {
    for (size_t a = 0; a < contacts; a++)
        for (size_t b = 0; b <= a; b++) {
            double total = 0.0;
            for (size_t j = 0; j < n; j++)
                total = total + shapes[a * n + j] * gain[j] * shapes[b * n + j];
            out[a * contacts + b] = total + residual[a * contacts + b];
        }
}

/* modes whose motion is kept at a time */
enum { SOME = 64 };

void predict_lags(int velocity, const double *rows, const double *shapes, size_t contacts, const double *weights, size_t points,
                  int mutual, size_t n, double *out) {
    double x[SOME][PREDICT_BLOCK];
    const double *trace = rows + 6 * n, *minus_det = rows + 7 * n, *kq = rows + 4 * n, *kv = rows + 5 * n;
    const double *on_q = rows + (velocity ? 2 * n : 0), *on_v = on_q + n;
    for (size_t c = 0; c < contacts; c++)
        for (size_t begin = 0; begin < n; begin += SOME) {
            const size_t some = n - begin < SOME ? n - begin : SOME;
            for (size_t i = 0; i < some; i++) {
                const size_t j = begin + i;
                const double q = kq[j] * shapes[c * n + j], v = kv[j] * shapes[c * n + j];
                x[i][0] = velocity ? v : q;
                x[i][1] = on_q[j] * q + on_v[j] * v;
                for (int k = 2; k < PREDICT_BLOCK; k++)
                    x[i][k] = trace[j] * x[i][k - 1] + minus_det[j] * x[i][k - 2];
            }
            for (size_t p = mutual ? c : 0; p < points; p++) {
                double *to = out + (p * contacts + c) * 2 * PREDICT_BLOCK + PREDICT_BLOCK, sum[PREDICT_BLOCK];
                for (int k = 0; k < PREDICT_BLOCK; k++)
                    sum[k] = begin ? to[k] : 0.0;
                for (size_t i = 0; i < some; i++)
                    for (int k = 0; k < PREDICT_BLOCK; k++)
                        sum[k] = sum[k] + weights[p * n + begin + i] * x[i][k];
                for (int k = 0; k < PREDICT_BLOCK; k++)
                    to[k] = sum[k];
            }
        }
}
