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

/* Adds the product of dense matrices, x y or x' y, to z. Every entry is the sum of the same terms
   in the same order as in CasADi's function, but entries do not wait for each other. */
static inline void ergoqp_mtimes_dense(const double* restrict x, long long rows, long long columns,
                                       const double* restrict y, long long count,
                                       double* restrict z, long long transposed) {
  long long i, j, k;
  if (transposed) {
    for (i = 0; i < count; ++i)
      for (j = 0; j < columns; ++j)
        for (k = 0; k < rows; ++k) z[j + i * columns] += x[k + j * rows] * y[k + i * rows];
    return;
  }
  i = 0;
  if (rows == 1) {
    for (; i + 3 < count; i += 4) {
      const double* at = y + i * columns;
      double a = z[i], b = z[i + 1], c = z[i + 2], d = z[i + 3];
      for (k = 0; k < columns; ++k) {
        a += x[k] * at[k];
        b += x[k] * at[k + columns];
        c += x[k] * at[k + 2 * columns];
        d += x[k] * at[k + 3 * columns];
      }
      z[i] = a;
      z[i + 1] = b;
      z[i + 2] = c;
      z[i + 3] = d;
    }
  }
  for (; i < count; ++i)
    for (k = 0; k < columns; ++k) {
      const double factor = y[k + i * columns];
      for (j = 0; j < rows; ++j) z[j + i * rows] += x[j + k * rows] * factor;
    }
}

#define fmin ergoqp_fmin
#define fmax ergoqp_fmax

#endif
