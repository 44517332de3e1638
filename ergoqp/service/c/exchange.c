/* From a request to the inputs of the step function, and from its outputs to the answer: what `ergoqp.service.loop` does in
 * Python where there is no C compiler, to the last bit. Nothing is allocated. */
#include <math.h>
#include <stdint.h>
#include <string.h>

#include "stop.h"

#define MOST_KNOTS 64
#define MOST_TWISTS 8192

enum { FRAME = 1, POSE = 2, TWIST = 4, OBSERVED = 8, ENABLE = 16 };

/* Where everything is: pointers, then offsets in bytes of the frames and in doubles of the function's arrays. */
typedef struct {
    const char* request;
    double* given;
    const double* results;
    char* answer;
    double average, acceleration[6];
    int32_t n, pose, twist, posture, observed;                        /* of the request */
    int32_t to_posture, to_observed, to_pose, to_has_pose, to_executed, to_has_twist, to_dt, to_age, to_frame, to_enable;
    int32_t from_twist, from_pose, from_state, from_rate, from_copied; /* of the results */
    int32_t copied, planned, sent;                                     /* how many */
    int32_t at_twist, at_pose, at_rate, at_copied, at_times, at_stop;  /* of the answer */
} exchange;

static void turned(void* to, const void* from) {
    double rows[16], columns[16];
    int i, j;
    memcpy(columns, from, sizeof columns);
    for (i = 0; i < 4; ++i)
        for (j = 0; j < 4; ++j) rows[4 * i + j] = columns[4 * j + i];
    memcpy(to, rows, sizeof rows);
}

/* Write a request into the inputs, which hold the usual values. Returns 0 if `observed` is no mask of zeros and ones. */
int ergoqp_take(const exchange* x, uint32_t flags, double dt, double age) {
    const size_t size = (size_t)x->n * sizeof(double);
    int i, mask = 1;
    if (flags & FRAME)
        memcpy(x->given + x->to_posture, x->request + x->posture, size);
    else
        x->given[x->to_frame] = 0.0;
    if (flags & OBSERVED) {
        double* observed = x->given + x->to_observed;
        memcpy(observed, x->request + x->observed, size);
        for (i = 0; i < x->n; ++i) mask = mask && (observed[i] == 0.0 || observed[i] == 1.0);
    }
    if (flags & POSE) {
        x->given[x->to_has_pose] = 1.0;
        turned(x->given + x->to_pose, x->request + x->pose);
    }
    if (flags & TWIST) {
        x->given[x->to_has_twist] = 1.0;
        memcpy(x->given + x->to_executed, x->request + x->twist, 6 * sizeof(double));
    }
    x->given[x->to_dt] = dt;
    x->given[x->to_age] = age;
    x->given[x->to_enable] = flags & ENABLE ? 1.0 : 0.0;
    return mask;
}

/* Choose which twists of a long stop become knots: close where it bends, the first and the last one always. */
static int thinned(double (*twists)[6], int count, double dt, double* times, double (*stop)[6]) {
    static double along[MOST_TWISTS];
    double sum = 0.0, spread, wanted;
    int k, i, chosen = 0, last = -1;
    along[0] = 0.0;
    for (k = 1; k < count; ++k) {
        double bend = 0.0;
        for (i = 0; k + 1 < count && i < 6; ++i)
            bend = fmax(bend, fabs(twists[k + 1][i] - 2 * twists[k][i] + twists[k - 1][i]));
        along[k] = sqrt(bend);
        sum += along[k];
    }
    spread = sum / (8 * count) + 1e-12;
    for (k = 1; k < count; ++k) along[k] += along[k - 1] + spread;
    for (i = k = 0; i < MOST_KNOTS; ++i) {
        wanted = i + 1 < MOST_KNOTS ? along[count - 1] * i / (MOST_KNOTS - 1) * (1 - 1e-12) : along[count - 1];
        while (k < count - 1 && along[k] < wanted) ++k;
        if (k == last) continue;
        last = k;
        times[chosen] = (k + 1) * dt;
        memcpy(stop[chosen++], twists[k], sizeof twists[k]);
    }
    return chosen;
}

/* Write the outputs into the answer, and the stop of the new state with twists of `dt` seconds. Returns how many knots. */
int ergoqp_tell(const exchange* x, double dt, int most) {
    static double twists[MOST_TWISTS][6];
    const double* state = x->results + x->from_state;
    double* times = (double*)(x->answer + x->at_times);
    double(*stop)[6] = (double(*)[6])(x->answer + x->at_stop);
    int count, k;
    memcpy(x->answer + x->at_twist, x->results + x->from_twist, 6 * sizeof(double));
    turned(x->answer + x->at_pose, x->results + x->from_pose);
    memcpy(x->answer + x->at_rate, x->results + x->from_rate, (size_t)x->n * sizeof(double));
    memcpy(x->answer + x->at_copied, x->results + x->from_copied, (size_t)x->copied * sizeof(double));
    count = ergoqp_stop_twists(state, x->planned, x->sent, x->average, dt, x->acceleration, twists,
                               most < MOST_TWISTS ? most : MOST_TWISTS);
    if (count > MOST_KNOTS) return thinned(twists, count, dt, times, stop);
    for (k = 0; k < count; ++k) times[k] = (k + 1) * dt;
    memcpy(stop, twists, (size_t)count * sizeof *twists);
    return count;
}
