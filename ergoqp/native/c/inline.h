/* fmin and fmax as two or three instructions instead of a call. Like those of glibc they drop a NaN (a constant is none), and
 * give the first one of two zeros. */
#ifndef ERGOQP_INLINE_H
#define ERGOQP_INLINE_H

#include <math.h>

#if defined(__GNUC__)
#define ERGOQP_CONSTANT(x) __builtin_constant_p(x)
#else
#define ERGOQP_CONSTANT(x) 0
#endif

static inline double ergoqp_fmin(double x, double y) {
  if (ERGOQP_CONSTANT(x)) return y < x ? y : x;
  return x != x ? y : y < x ? y : x;
}

static inline double ergoqp_fmax(double x, double y) {
  if (ERGOQP_CONSTANT(x)) return y > x ? y : x;
  return x != x ? y : y > x ? y : x;
}

#define fmin ergoqp_fmin
#define fmax ergoqp_fmax

#endif
