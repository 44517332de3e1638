/* Rest postures of many places at once: the loop of ModelPerson.settle, one place in each lane.

   Every lane has its own state, so a lane that has come to rest takes the next place at once. */

#include <math.h>

typedef double lanes __attribute__((vector_size(8 * LANES)));
typedef long long flags __attribute__((vector_size(8 * LANES)));

static inline lanes all(double x) { return x - (lanes){0}; }
static inline lanes chosen(flags f, lanes a, lanes b) { return (lanes)((f & (flags)a) | (~f & (flags)b)); }
static inline lanes truth(flags f) { return (lanes)(f & (flags)all(1.0)); }
static inline lanes least(lanes a, lanes b) { return chosen(a < b, a, b); }
static inline lanes most(lanes a, lanes b) { return chosen(a > b, a, b); }
static inline lanes within(lanes a, double low, double high) {
    return chosen(a < low, all(low), chosen(a > high, all(high), a));
}
static inline lanes size(lanes a) { return chosen(a < 0, -a, a); }
#define EACH(name, call) \
    static inline lanes name(lanes a) { lanes r; for (int i = 0; i < LANES; ++i) r[i] = call(a[i]); return r; }
EACH(root, sqrt)
EACH(arcsine, asin)
EACH(arccosine, acos)
static inline lanes arctangent2(lanes y, lanes x) {
    lanes r;
    for (int i = 0; i < LANES; ++i) r[i] = atan2(y[i], x[i]);
    return r;
}

/* Sine and cosine by their series about the nearest multiple of a quarter turn, within 2.3e-16 for
   angles up to some turns. The first part of pi / 2 has 33 bits, so that its multiples are exact. */
static inline lanes from_quarter(lanes x, flags* quarter) {
    const double first = 0x1.921fb544p+0, rest = 0x1.0b4611a626331p-34, whole = 0x1.8p52;
    lanes shifted = x * (1.0 / 0x1.921fb54442d18p+0) + whole, quarters = shifted - whole;
    *quarter = (flags)shifted;
    return (x - quarters * first) - quarters * rest;
}
static inline lanes series(lanes square, int terms, const double* factors) {
    lanes sum = all(factors[0]);
    for (int k = 1; k < terms; ++k) sum = sum * square + factors[k];
    return sum;
}
static inline lanes turned(lanes r, flags quarter) {
    static const double of_sine[] = {-1 / 1307674368000.0, 1 / 6227020800.0, -1 / 39916800.0,
                                     1 / 362880.0, -1 / 5040.0, 1 / 120.0, -1 / 6.0};
    static const double of_cosine[] = {1 / 20922789888000.0, -1 / 87178291200.0, 1 / 479001600.0,
                                       -1 / 3628800.0, 1 / 40320.0, -1 / 720.0, 1 / 24.0, -0.5};
    lanes square = r * r;
    lanes sine = r + r * (square * series(square, 7, of_sine));
    lanes cosine = 1.0 + square * series(square, 8, of_cosine);
    lanes value = chosen((quarter & 1) != 0, cosine, sine);
    return chosen((quarter & 2) != 0, -value, value);
}
static inline lanes sine(lanes x) {
    flags quarter;
    lanes r = from_quarter(x, &quarter);
    return turned(r, quarter);
}
static inline lanes cosine(lanes x) {
    flags quarter;
    lanes r = from_quarter(x, &quarter);
    return turned(r, quarter + 1);
}
