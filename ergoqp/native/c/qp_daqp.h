/* One dense QP by DAQP (Arnstroem, Bemporad, Axehill, IEEE TAC 67(8), 2022), in memory that the caller gives.
 *
 *   min 1/2 x'Hx + g'x   subject to   lba <= A x <= uba,  lbx <= x <= ubx
 *
 * DAQP's own entry points allocate and free for every problem. Its inner ones do not, so its workspace is laid out here in
 * `w` and `marks`: nothing is allocated, nothing is kept, and the same data give the same answer whatever was solved before.
 */
#ifndef ERGOQP_QP_DAQP_H
#define ERGOQP_QP_DAQP_H

#include <math.h>
#include <string.h>

#include <daqp/api.h>
#include <daqp/utils.h>

#ifndef casadi_int
#define casadi_int long long int
#endif

#define ERGOQP_QP_DOUBLES(n, m) \
    (2 * (n) * (m) + (n) * (n) + 5 * ((n) + (m)) + (n) * ((n) + 1) / 2 + ((n) + 1) * ((n) + 2) / 2 + 10 * (n) + 5)
#define ERGOQP_QP_MARKS(n, m) (2 * ((n) + (m)) + 2 * (n) + 1)

static double* ergoqp_take(double** w, int count) {
    double* taken = *w;
    *w += count;
    return taken;
}

/* Whether unknown i is alone: no cost but its own curvature, in no row, and 0 within its bounds. Its answer is 0. */
static int ergoqp_alone(int n, int m, const double** arg, int i) {
    int j;
    if (arg[1][i] != 0.0 || !(arg[5][i] <= 0.0) || !(arg[6][i] >= 0.0)) return 0;
    for (j = 0; j < n; ++j)
        if (j != i && (arg[0][i * n + j] != 0.0 || arg[0][j * n + i] != 0.0)) return 0;
    for (j = 0; j < m; ++j)
        if (arg[2][i * m + j] != 0.0) return 0;
    return 1;
}

/* arg: H (n, n), g, A (m, n), lba, uba, lbx, ubx, column-major; res: x, multipliers of the rows, multipliers of the bounds,
 * positive at upper ends. Where there is no answer x is NaN: the step that asked judges every answer by its residuals.
 * Unknowns that are alone (the slack of a row that does not give way) are left out before DAQP sees the problem, except for
 * the first one: with it, DAQP never has as many active constraints as unknowns, where it rounds in another way, and the
 * answer is that of the whole problem to the bit. */
static int ergoqp_qp_daqp(int n, int m, const double** arg, double** res, double* w, int* marks) {
    DAQPSettings settings;
    DAQPProblem qp;
    DAQPWorkspace work;
    int i, j, flag, k = 0, spared = 0;
    int* kept = marks;
    double *rows, *upper, *lower, *H, *g;

    for (i = 0; i < n; ++i)
        if (!ergoqp_alone(n, m, arg, i) || !spared++) kept[k++] = i;
    marks += n;
    rows = ergoqp_take(&w, k * m);
    upper = ergoqp_take(&w, k + m);
    lower = ergoqp_take(&w, k + m);
    H = ergoqp_take(&w, k * k);
    g = ergoqp_take(&w, k);

    daqp_default_settings(&settings);
    settings.primal_tol = 1e-9;
    settings.dual_tol = 1e-10;
    settings.iter_limit = 500;

    for (i = 0; i < k; ++i) {
        for (j = 0; j < k; ++j) H[i * k + j] = arg[0][kept[i] * n + kept[j]];
        for (j = 0; j < m; ++j) rows[j * k + i] = arg[2][kept[i] * m + j];
        g[i] = arg[1][kept[i]];
        lower[i] = arg[5][kept[i]];
        upper[i] = arg[6][kept[i]];
    }
    for (i = 0; i < m; ++i) {
        lower[k + i] = arg[3][i];
        upper[k + i] = arg[4][i];
    }
    memset(marks, 0, sizeof(int) * (size_t)(ERGOQP_QP_MARKS(n, m) - n));

    qp.n = k;
    qp.m = k + m;
    qp.ms = k;
    qp.H = H;
    qp.f = g;
    qp.A = rows;
    qp.bupper = upper;
    qp.blower = lower;
    qp.sense = marks;

    memset(&work, 0, sizeof work);
    work.qp = &qp;
    work.settings = &settings;
    work.n = k;
    work.m = k + m;
    work.ms = k;
    work.sing_ind = EMPTY_IND;
    work.sense = marks + k + m;
    work.WS = marks + 2 * (k + m);
    work.scaling = ergoqp_take(&w, k + m);
    work.M = ergoqp_take(&w, k * m);
    work.dupper = ergoqp_take(&w, k + m);
    work.dlower = ergoqp_take(&w, k + m);
    work.Rinv = ergoqp_take(&w, k * (k + 1) / 2);
    work.v = ergoqp_take(&w, k);
    work.lam = ergoqp_take(&w, k + 1);
    work.lam_star = ergoqp_take(&w, k + 1);
    work.D = ergoqp_take(&w, k + 1);
    work.xldl = ergoqp_take(&w, k + 1);
    work.zldl = ergoqp_take(&w, k + 1);
    work.L = ergoqp_take(&w, (k + 1) * (k + 2) / 2);
    work.u = ergoqp_take(&w, k);
    work.x = ergoqp_take(&w, k);
    work.xold = ergoqp_take(&w, k);
    for (i = 0; i < k; ++i) work.scaling[i] = 1.0;

    flag = update_ldp(UPDATE_Rinv | UPDATE_M | UPDATE_v | UPDATE_d | UPDATE_sense, &work);
    if (flag >= 0) flag = activate_constraints(&work);
    if (flag >= 0) flag = daqp_ldp(&work);
    if (flag > 0) ldp2qp_solution(&work);

    for (i = 0; i < n; ++i) {
        if (res[0]) res[0][i] = flag > 0 ? 0.0 : NAN;
        if (res[2]) res[2][i] = 0.0;
    }
    if (res[1]) memset(res[1], 0, sizeof(double) * (size_t)m);
    for (i = 0; flag > 0 && i < k && res[0]; ++i) res[0][kept[i]] = work.x[i];
    for (i = 0; flag > 0 && i < work.n_active; ++i) {
        j = work.WS[i];
        if (j < k && res[2]) res[2][kept[j]] = work.lam_star[i];
        if (j >= k && res[1]) res[1][j - k] = work.lam_star[i];
    }
    return 0;
}

#endif
