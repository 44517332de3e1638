/* The certified stop in closed form: the twists that braking period by period would send.
 *
 * The plan u ramps down along a straight line, in max |u_i| / a_i seconds; what is sent is its mean over the last `average`
 * seconds. Nothing is allocated: the plan is written to `twists`, and the means replace it from the last one backward, by
 * integrals that run from the end.
 */
#ifndef ERGOQP_STOP_H
#define ERGOQP_STOP_H

#include <math.h>
#include <string.h>

/* history: `planned` twists, newest first, then `sent` twists, newest first, then the ages of the ends of the periods before
 * the last one [s]. Writes at most `most` twists of `dt` seconds each, the last one zero; returns how many. */
static int ergoqp_stop_twists(const double* history, int planned, int sent, double average, double dt,
                              const double acceleration[6], double (*twists)[6], int most) {
    const double* ages = history + 6 * (planned + sent);
    const double* last = history + 6 * planned;
    double now[6], later[6], mean[6], far[6] = {0.0}, near[6] = {0.0};
    int count = 0, moving = 1, rest = average > 0.0 ? (int)ceil(average / dt) + 1 : 0, axis, k;

    /* Entry e of the plan: the history from its oldest twist, then the braking twists. */
#define PLAN(e) ((e) < planned ? history + 6 * (planned - 1 - (e)) : twists[(e)-planned])
#define TIME(e) ((e) < planned - 1 ? -ages[planned - 2 - (e)] : ((e) - (planned - 1)) * dt)

    while (count < most && (moving || rest-- > 0)) {
        const double* u = count ? twists[count - 1] : history;
        double seconds = 0.0, share;
        for (axis = 0; axis < 6; ++axis) seconds = fmax(seconds, fabs(u[axis]) / acceleration[axis]);
        share = fmax(0.0, 1.0 - dt / fmax(seconds, 1e-12));
        for (moving = 0, axis = 0; axis < 6; ++axis) {
            twists[count][axis] = u[axis] * share;
            if (twists[count][axis] != 0.0) moving = 1;
        }
        ++count;
    }
    if (average > 0.0) {
        /* far, near: integrals of the plan from the start and from the end of the window to the end of the stop. The plan of
         * the end of the window is in `now`, that of a period later in `later`: a mean is in its place by then. */
        int oldest = planned - 1 + count; /* first entry that `far` covers */
        for (k = count; k >= 1; --k) {
            const int end = planned - 1 + k;
            /* A history that is too short: its oldest twist counts as having lasted for ever. */
            const int least = k < planned ? k - 1 : planned - 1;
            const double from = k * dt - average;
            const double *u, *v;
            double inside, length;
            memcpy(now, twists[k - 1], sizeof now);
            while (1) {
                v = oldest > end ? later : PLAN(oldest);
                inside = TIME(oldest) - from;
                if (oldest <= least || inside <= 0.0 || TIME(oldest - 1) < from) break;
                u = PLAN(oldest - 1);
                length = TIME(oldest) - TIME(oldest - 1);
                for (axis = 0; axis < 6; ++axis) far[axis] += length * (u[axis] + v[axis]) / 2;
                --oldest;
            }
            inside = fmax(inside, 0.0);
            u = oldest > least ? PLAN(oldest - 1) : v;
            length = oldest > least ? TIME(oldest) - TIME(oldest - 1) : 1.0;
            for (axis = 0; axis < 6; ++axis) {
                double first = v[axis] + (u[axis] - v[axis]) * inside / length;
                mean[axis] = (far[axis] + inside * (first + v[axis]) / 2 - near[axis]) / average;
                near[axis] += dt * (PLAN(end - 1)[axis] + now[axis]) / 2;
            }
            memcpy(twists[k - 1], mean, sizeof mean);
            memcpy(later, now, sizeof later);
        }
        /* As a step keeps the acceleration where a history is too short. */
        for (k = 0; k < count; ++k)
            for (axis = 0; axis < 6; ++axis) {
                double before = k ? twists[k - 1][axis] : last[axis], change = acceleration[axis] * dt;
                twists[k][axis] = fmin(fmax(twists[k][axis], before - change), before + change);
            }
    }
#undef PLAN
#undef TIME
    for (k = 0; k < count; ++k) {
        for (axis = 0; axis < 6 && twists[k][axis] == 0.0; ++axis) continue;
        if (axis == 6) return k + 1;
    }
    return count;
}

#endif
