/* bank_predict.h: what tables of a string's model would be by their formulas, in arithmetic that gives the same bits on every
 * processor: predicted.py line by line, whose docstrings say what each is. To be compiled without contraction.
 *
 * n: numbers in a row of modes; rows [14][n], shapes [contacts][n]. What lies behind the own modes is not written.
 */
#ifndef JAWARI_BANK_PREDICT_H
#define JAWARI_BANK_PREDICT_H

#include <stddef.h>

enum { PREDICT_BLOCK = 8, PREDICT_ROWS = 14, PREDICT_STRING = 9 };

/* omega, sigma: NULL where it is not wanted */
void predict_modes(const double *string, int linear, const double *nut, size_t nuts, double ratio, double loss, size_t own,
                   double *omega, double *sigma);
void predict_shape(double x, double length, size_t own, double *out);
void predict_heard(double x, double length, double half, double gain, size_t own, double *out);
/* weights and out: two rows */
void predict_filtered(const double *omega, const double *weights, size_t weights_n, const double *taps, size_t count, double rate,
                      size_t n, double *out);
void predict_hold_rows(const double *omega, const double *sigma, double mu, double dt, size_t modes, size_t n, double *rows);
void predict_impulse_rows(const double *omega, double mu, size_t modes, size_t n, double *rows);
void predict_later_rows(size_t n, double *rows);
void predict_matrix(const double *gain, const double *shapes, const double *residual, size_t contacts, size_t n, double *out);
/* out [points][contacts][16], the second halves; mutual: of points from each contact on */
void predict_lags(int velocity, const double *rows, const double *shapes, size_t contacts, const double *weights, size_t points,
                  int mutual, size_t n, double *out);

#endif
