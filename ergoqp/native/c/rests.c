#include "rests.h"

#include "step.h"

/* Settles n places. q (n, 32): postures to start from, and at rest; targets (n, TARGETS);
   found (n, 2): distance and angle of the last step. */
void ergoqp_rests(double* q, long long n, const double* targets, const double* soles,
                  const double* constants, const double* lower, const double* upper, double relax,
                  long long steps, double tolerance, double* found) {
    lanes posture[JOINTS], locked[JOINTS], target[TARGETS], sole[32], step[JOINTS], away[2];
    long long place[LANES], done[LANES], pass[LANES], next = 0, live = 0;
    for (int i = 0; i < 32; ++i) sole[i] = all(soles[i]);
    for (int j = 0; j < LANES; ++j) place[j] = -1;
    for (;;) {
        for (int j = 0; j < LANES; ++j) {
            if (place[j] >= 0) continue;
            if (next < n) {
                place[j] = next++;
                ++live;
            }
            /* Where nothing is left, the lane computes the first place again, for nobody. */
            done[j] = pass[j] = 0;
            long long from = place[j] >= 0 ? place[j] : 0;
            for (int i = 0; i < JOINTS; ++i) {
                posture[i][j] = q[JOINTS * from + i];
                locked[i][j] = 0;
            }
            for (int i = 0; i < TARGETS; ++i) target[i][j] = targets[TARGETS * from + i];
        }
        if (!live) return;
        person_step(posture, locked, target, sole, all(1.0), all(relax), constants, step, away);
        for (int j = 0; j < LANES; ++j) {
            if (place[j] < 0) continue;
            int newly = 0;
            double change = 0;
            for (int i = 0; i < JOINTS && pass[j] < 3; ++i) {
                double at = posture[i][j], after = at + step[i][j];
                int blocked = (after > upper[i] && at >= upper[i] - 1e-9) ||
                              (after < lower[i] && at <= lower[i] + 1e-9);
                if (blocked && locked[i][j] < 0.5) {
                    locked[i][j] = 1;
                    newly = 1;
                }
            }
            if (newly) {
                ++pass[j];
                continue;
            }
            int number = 1;
            for (int i = 0; i < JOINTS; ++i) {
                double at = posture[i][j], after = at + step[i][j];
                after = after < lower[i] ? lower[i] : after > upper[i] ? upper[i] : after;
                double moved = fabs(after - at);
                number &= moved == moved;
                change = moved > change ? moved : change;
                posture[i][j] = after;
                locked[i][j] = 0;
            }
            pass[j] = 0;
            if (++done[j] < steps && !(number && change < tolerance)) continue;
            for (int i = 0; i < JOINTS; ++i) q[JOINTS * place[j] + i] = posture[i][j];
            found[2 * place[j]] = away[0][j];
            found[2 * place[j] + 1] = away[1][j];
            place[j] = -1;
            --live;
        }
    }
}
