/* fmin and fmax as two instructions instead of a call. Like those of the C library they drop a NaN. */
#ifndef ERGOQP_INLINE_H
#define ERGOQP_INLINE_H

#include <math.h>

static inline double ergoqp_fmin(double x, double y) { return (x < y || y != y) ? x : y; }
static inline double ergoqp_fmax(double x, double y) { return (x > y || y != y) ? x : y; }

#define fmin ergoqp_fmin
#define fmax ergoqp_fmax

#endif
