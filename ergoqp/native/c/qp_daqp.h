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

#define ERGOQP_QP_DOUBLES(n, m) (2 * (n) * (m) + 5 * ((n) + (m)) + (n) * ((n) + 1) / 2 + ((n) + 1) * ((n) + 2) / 2 + 9 * (n) + 5)
#define ERGOQP_QP_MARKS(n, m) (2 * ((n) + (m)) + (n) + 1)

static double* ergoqp_take(double** w, int count) {
    double* taken = *w;
    *w += count;
    return taken;
}

/* arg: H (n, n), g, A (m, n), lba, uba, lbx, ubx, column-major; res: x, multipliers of the rows, multipliers of the bounds,
 * positive at upper ends. Where there is no answer x is NaN: the step that asked judges every answer by its residuals. */
static int ergoqp_qp_daqp(int n, int m, const double** arg, double** res, double* w, int* marks) {
    DAQPSettings settings;
    DAQPProblem qp;
    DAQPWorkspace work;
    int i, j, flag;
    double* rows = ergoqp_take(&w, n * m);
    double* upper = ergoqp_take(&w, n + m);
    double* lower = ergoqp_take(&w, n + m);

    daqp_default_settings(&settings);
    settings.primal_tol = 1e-9;
    settings.dual_tol = 1e-10;
    settings.iter_limit = 500;

    for (i = 0; i < m; ++i)
        for (j = 0; j < n; ++j) rows[i * n + j] = arg[2][j * m + i];
    for (i = 0; i < n; ++i) {
        lower[i] = arg[5][i];
        upper[i] = arg[6][i];
    }
    for (i = 0; i < m; ++i) {
        lower[n + i] = arg[3][i];
        upper[n + i] = arg[4][i];
    }
    memset(marks, 0, sizeof(int) * (size_t)ERGOQP_QP_MARKS(n, m));

    qp.n = n;
    qp.m = n + m;
    qp.ms = n;
    qp.H = (double*)arg[0];
    qp.f = (double*)arg[1];
    qp.A = rows;
    qp.bupper = upper;
    qp.blower = lower;
    qp.sense = marks;

    memset(&work, 0, sizeof work);
    work.qp = &qp;
    work.settings = &settings;
    work.n = n;
    work.m = n + m;
    work.ms = n;
    work.sing_ind = EMPTY_IND;
    work.sense = marks + n + m;
    work.WS = marks + 2 * (n + m);
    work.scaling = ergoqp_take(&w, n + m);
    work.M = ergoqp_take(&w, n * m);
    work.dupper = ergoqp_take(&w, n + m);
    work.dlower = ergoqp_take(&w, n + m);
    work.Rinv = ergoqp_take(&w, n * (n + 1) / 2);
    work.v = ergoqp_take(&w, n);
    work.lam = ergoqp_take(&w, n + 1);
    work.lam_star = ergoqp_take(&w, n + 1);
    work.D = ergoqp_take(&w, n + 1);
    work.xldl = ergoqp_take(&w, n + 1);
    work.zldl = ergoqp_take(&w, n + 1);
    work.L = ergoqp_take(&w, (n + 1) * (n + 2) / 2);
    work.u = ergoqp_take(&w, n);
    work.x = ergoqp_take(&w, n);
    work.xold = ergoqp_take(&w, n);
    for (i = 0; i < n; ++i) work.scaling[i] = 1.0;

    flag = update_ldp(UPDATE_Rinv | UPDATE_M | UPDATE_v | UPDATE_d | UPDATE_sense, &work);
    if (flag >= 0) flag = activate_constraints(&work);
    if (flag >= 0) flag = daqp_ldp(&work);
    if (flag > 0) ldp2qp_solution(&work);

    for (i = 0; i < n; ++i) {
        if (res[0]) res[0][i] = flag > 0 ? work.x[i] : NAN;
        if (res[2]) res[2][i] = 0.0;
    }
    if (res[1]) memset(res[1], 0, sizeof(double) * (size_t)m);
    for (i = 0; flag > 0 && i < work.n_active; ++i) {
        j = work.WS[i];
        if (j < n && res[2]) res[2][j] = work.lam_star[i];
        if (j >= n && res[1]) res[1][j - n] = work.lam_star[i];
    }
    return 0;
}

#endif
