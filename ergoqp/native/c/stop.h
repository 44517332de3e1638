/* The certified stop in closed form: the twists that braking period by period would send.
 *
 * From the last planned twist u the plan ramps down along a straight line, in max |u_i| / a_i seconds. What is sent is the
 * mean of the plan over the last `average` seconds: u times the integral of the ramp, plus that of the history. Nothing is
 * allocated.
 */
#ifndef ERGOQP_STOP_H
#define ERGOQP_STOP_H

#include <math.h>

/* Share of u that is planned for the end of period k. */
static double ergoqp_ramp(int k, double dt, double seconds) { return k * dt < seconds ? 1.0 - k * dt / seconds : 0.0; }

/* history: `planned` twists, newest first, then `sent` twists, newest first, then the ages of the ends of the periods before
 * the last one [s]. Writes at most `most` twists of `dt` seconds each, the last one zero; returns how many. */
static int ergoqp_stop_twists(const double* history, int planned, int sent, double average, double dt,
                              const double acceleration[6], double (*twists)[6], int most) {
    const double *u = history, *before = history + 6 * planned, *ages = history + 6 * (planned + sent);
    const double mean = average > 0.0 ? 1.0 / average : 0.0;
    double seconds = 0.0, here = 1.0, done = 0.0, then = 1.0, gone = 0.0, newer = 0.0, far[6] = {0.0};
    int axis, k, i = 0, reaching = 0, count;

    for (axis = 0; axis < 6; ++axis) {
        double needed = fabs(u[axis]) / acceleration[axis];
        seconds = needed > seconds ? needed : seconds;
    }
    count = (int)ceil(seconds / dt) + (average > 0.0 ? (int)ceil(average / dt) + 1 : 0) + 1;
    count = count < most ? count : most;

    /* The share of the ramp: `done` is its integral up to the end of a period, `gone` that up to the start of the mean. */
    for (k = 1; k <= count; ++k) {
        double next = ergoqp_ramp(k, dt, seconds), from = k * dt - average, share = next;
        if (average > 0.0) {
            done += dt * (here + next) / 2;
            share = mean * done;
            if (from < 0.0) {
                reaching = k; /* it reaches back into the history */
            } else {
                double inside, after;
                while ((i + 1) * dt <= from) {
                    after = ergoqp_ramp(++i, dt, seconds);
                    gone += dt * (then + after) / 2;
                    then = after;
                }
                inside = from - i * dt;
                after = then + (ergoqp_ramp(i + 1, dt, seconds) - then) * inside / dt;
                share = mean * (done - (gone + inside * (then + after) / 2));
            }
        }
        here = next;
        for (axis = 0; axis < 6; ++axis) twists[k - 1][axis] = u[axis] * share;
    }

    /* The share of the history, backward: `far` is its integral from the end of entry i to now. */
    for (k = reaching, i = 0; k >= 1; --k) {
        /* In period k so many entries have left the history, and the oldest one counts as having lasted for ever. */
        const int oldest = planned - k > 0 ? planned - k : 0;
        const double from = k * dt - average;
        double inside, part = 0.0;
        const double* v;
        while (i < oldest && -ages[i] >= from) {
            for (v = history + 6 * i, axis = 0; axis < 6; ++axis) far[axis] += (ages[i] - newer) * (v[axis] + v[axis + 6]) / 2;
            newer = ages[i++];
        }
        v = history + 6 * i;
        inside = -newer - from;
        if (i < oldest) part = inside / (ages[i] - newer) / 2;
        for (axis = 0; axis < 6; ++axis) {
            double step = i < oldest ? (v[axis + 6] - v[axis]) * part : 0.0;
            twists[k - 1][axis] += mean * (far[axis] + inside * (v[axis] + step));
        }
    }

    /* A step keeps the acceleration where the history is too short for a mean. */
    for (k = 0, i = 1; k < count && (k < reaching || i); ++k) {
        const double* last = k ? twists[k - 1] : before;
        for (i = 0, axis = 0; axis < 6; ++axis) {
            double change = twists[k][axis] - last[axis], largest = acceleration[axis] * dt;
            if (fabs(change) > largest) {
                twists[k][axis] = last[axis] + (change > 0.0 ? largest : -largest);
                i = 1;
            }
        }
    }

    for (k = 0; k < count; ++k) {
        for (axis = 0; axis < 6 && twists[k][axis] == 0.0; ++axis) continue;
        if (axis == 6) return k + 1;
    }
    return count;
}

#endif
