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
static inline lanes size(lanes a) { return chosen(a < 0, -a, a); }
#define EACH(name, call) \
    static inline lanes name(lanes a) { lanes r; for (int i = 0; i < LANES; ++i) r[i] = call(a[i]); return r; }
EACH(root, sqrt)
EACH(sine, sin)
EACH(cosine, cos)
EACH(arcsine, asin)
EACH(arccosine, acos)
static inline lanes arctangent2(lanes y, lanes x) {
    lanes r;
    for (int i = 0; i < LANES; ++i) r[i] = atan2(y[i], x[i]);
    return r;
}
