#include "rests.h"

#include "step.h"

/* What a lane remembers to accelerate its steps, after Anderson (1965): the last changes of the
   step and of where it ends. Changes that a lane does not have are zero. */
typedef struct {
    lanes steps[HISTORY][JOINTS], ends[HISTORY][JOINTS], products[HISTORY][HISTORY];
    lanes step[JOINTS], end[JOINTS];
    flags known, newest;
} Memory;

static void forget(Memory* m, flags lane) {
    for (int k = 0; k < HISTORY; ++k) {
        for (int i = 0; i < JOINTS; ++i) {
            m->steps[k][i] = chosen(lane, all(0.0), m->steps[k][i]);
            /* No share of what is no number is zero. */
            m->ends[k][i] = chosen(lane, all(0.0), m->ends[k][i]);
        }
        for (int l = 0; l < HISTORY; ++l)
            m->products[k][l] = chosen(lane, all(0.0), m->products[k][l]);
    }
    m->known &= ~lane;
}

static lanes dot(const lanes* a, const lanes* b) {
    lanes even = all(0.0), odd = all(0.0);
    for (int i = 0; i < JOINTS; i += 2) {
        even += a[i] * b[i];
        odd += a[i + 1] * b[i + 1];
    }
    return even + odd;
}

static void remember(Memory* m, const lanes* step, const lanes* end, flags moved) {
    flags both = moved & m->known, next = m->newest + 1;
    lanes by[JOINTS], to[JOINTS], products[HISTORY];
    m->newest = (moved & (next < HISTORY) & next) | (~moved & m->newest);
    for (int i = 0; i < JOINTS; ++i) {
        by[i] = chosen(both, step[i] - m->step[i], all(0.0));
        to[i] = chosen(both, end[i] - m->end[i], all(0.0));
        m->step[i] = chosen(moved, step[i], m->step[i]);
        m->end[i] = chosen(moved, end[i], m->end[i]);
    }
    for (int k = 0; k < HISTORY; ++k) {
        flags here = moved & (m->newest == k);
        for (int i = 0; i < JOINTS; ++i) {
            m->steps[k][i] = chosen(here, by[i], m->steps[k][i]);
            m->ends[k][i] = chosen(here, to[i], m->ends[k][i]);
        }
        products[k] = dot(by, m->steps[k]);
    }
    for (int k = 0; k < HISTORY; ++k) {
        flags here = moved & (m->newest == k);
        for (int l = 0; l < HISTORY; ++l)
            m->products[k][l] = m->products[l][k] = chosen(here, products[l], m->products[k][l]);
    }
    m->known |= moved;
}

/* Shares of the changes of which the step is made up best, by LDL'. */
static void shares_of(const Memory* m, const lanes* step, lanes* x) {
    lanes L[HISTORY][HISTORY], d[HISTORY];
    for (int k = 0; k < HISTORY; ++k) {
        x[k] = dot(m->steps[k], step);
        d[k] = m->products[k][k] * (1.0 + RIDGE) + 1e-300;
        for (int l = 0; l < k; ++l) {
            lanes sum = m->products[k][l];
            for (int p = 0; p < l; ++p) sum -= L[k][p] * d[p] * L[l][p];
            L[k][l] = sum / d[l];
            d[k] -= L[k][l] * L[k][l] * d[l];
            x[k] -= L[k][l] * x[l];
        }
    }
    for (int k = HISTORY - 1; k >= 0; --k) {
        x[k] /= d[k];
        for (int l = k + 1; l < HISTORY; ++l) x[k] -= L[l][k] * x[l];
    }
}

/* Settles n places. q (n, 32): postures to start from, and at rest; targets (n, TARGETS);
   found (n, 2): distance and angle of the last step. At a place that is not within `reach` (2) of
   both after `patience` steps, it is left at that. */
void ergoqp_rests(double* q, long long n, const double* targets, const double* soles,
                  const double* constants, const double* lower, const double* upper, double relax,
                  long long steps, double tolerance, long long patience, const double* reach,
                  double* found) {
    lanes posture[JOINTS], locked[JOINTS], target[TARGETS], sole[32], step[JOINTS], end[JOINTS];
    lanes away[2], shares[HISTORY], part;
    Memory memory = {0};
    long long place[LANES], done[LANES], pass[LANES], next = 0, live = 0;
    if (n <= 0) return;
    for (int i = 0; i < 32; ++i) sole[i] = all(soles[i]);
    for (int j = 0; j < LANES; ++j) place[j] = -1;
    for (;;) {
        flags fresh = {0}, patient, newly = {0}, number = ~(flags){0};
        for (int j = 0; j < LANES; ++j) {
            if (place[j] >= 0) continue;
            if (next < n) {
                place[j] = next++;
                ++live;
            }
            /* Where nothing is left, the lane computes the first place again, for nobody. */
            done[j] = pass[j] = 0;
            fresh[j] = -1;
            long long from = place[j] >= 0 ? place[j] : 0;
            for (int i = 0; i < JOINTS; ++i) {
                posture[i][j] = q[JOINTS * from + i];
                locked[i][j] = 0;
            }
            for (int i = 0; i < TARGETS; ++i) target[i][j] = targets[TARGETS * from + i];
        }
        if (!live) return;
        forget(&memory, fresh);
        person_step(posture, locked, target, sole, all(1.0), all(relax), constants, step, away);
        for (int j = 0; j < LANES; ++j) {
            patient[j] = -(pass[j] < 3);
            long long halvings = done[j] / HALVED;
            part[j] = 1.0 / (1 << (halvings < MOST_HALVINGS ? halvings : MOST_HALVINGS));
        }
        lanes change = all(0.0);
        for (int i = 0; i < JOINTS; ++i) {
            lanes after = posture[i] + step[i];
            flags over = (after > upper[i]) & (posture[i] >= upper[i] - 1e-9);
            flags under = (after < lower[i]) & (posture[i] <= lower[i] + 1e-9);
            flags blocked = (over | under) & (locked[i] == 0.0) & patient;
            locked[i] = chosen(blocked, all(1.0), locked[i]);
            newly |= blocked;
            end[i] = within(after, lower[i], upper[i]);
            step[i] = end[i] - posture[i];
            number &= step[i] == step[i];
            change = most(size(step[i]), change);
        }
        flags moved = ~newly, near = moved & number & (change < NEAR);
        remember(&memory, step, end, moved);
        shares_of(&memory, step, shares);
        for (int i = 0; i < JOINTS; ++i) {
            lanes better = end[i];
            for (int k = 0; k < HISTORY; ++k) better -= shares[k] * memory.ends[k][i];
            better = within(better, lower[i], upper[i]);
            lanes onward = chosen(near, better, end[i] - (1.0 - part) * step[i]);
            posture[i] = chosen(moved, onward, posture[i]);
            locked[i] = chosen(moved, all(0.0), locked[i]);
        }
        for (int j = 0; j < LANES; ++j) {
            pass[j] = newly[j] ? pass[j] + 1 : 0;
            if (place[j] < 0 || newly[j]) continue;
            int reached = away[0][j] < reach[0] && away[1][j] < reach[1];
            if (++done[j] < (reached ? steps : patience) && !(number[j] && change[j] < tolerance))
                continue;
            for (int i = 0; i < JOINTS; ++i) q[JOINTS * place[j] + i] = end[i][j];
            found[2 * place[j]] = away[0][j];
            found[2 * place[j] + 1] = away[1][j];
            place[j] = -1;
            --live;
        }
    }
}
