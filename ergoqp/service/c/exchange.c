/* From a request to the inputs of the step function, and from its outputs to the answer: what `ergoqp.service.loop` does in
 * Python where there is no C compiler, to the last bit. Nothing is allocated.
 *
 * `ergoqp_exchange` does the whole way of a plain step, from receiving to sending. It leaves all else to Python: it takes a
 * request only if the client acted on the last answer and asks for nothing but a step, and sends an answer only if there is
 * nothing to explain. */
#define _POSIX_C_SOURCE 200809L
#include <errno.h>
#include <math.h>
#include <stdint.h>
#include <string.h>
#include <sys/socket.h>
#include <time.h>

#include "stop.h"

#define MOST_KNOTS 64
#define MOST_TWISTS 8192

enum { FRAME = 1, POSE = 2, TWIST = 4, OBSERVED = 8, ENABLE = 16, EXPLAIN = 2048 };
enum { OPTIMAL = 0, SETTLED = 1 };

/* What was done with bytes that arrived. */
enum { RECEIVED = 0, COMPUTED = 1, SENT = 2, NOT_SENT = 3 };

typedef long long index;
typedef int (*function)(const double**, double**, index*, double*, int);

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
    int32_t at_text, text, rows, from_margins, from_status, from_causes, from_doubted, from_drawn; /* drawn: -1 for none */
    int32_t inputs, to_state, states, request_length, answer_length, settled, still, armed;
    int32_t version, ask, told, engine;
    uint64_t session, sequence, digest;
    double dt, shortest, longest, stop_seconds, doubted;
    const double *usual, *state, *tolerance;
    function step;
    const double** arguments;
    double **outputs, *work;
    index* indices;
} exchange;

#pragma pack(push, 1)
typedef struct {
    uint32_t length;
    uint16_t version, kind;
    uint64_t session, sequence, acted, problem;
    uint32_t followed, flags, coordinates, contact;
    double age, dt;
} request_head;

typedef struct {
    uint32_t length;
    uint16_t version, kind;
    uint64_t session, sequence;
    uint16_t engine, drawn;
    uint32_t status, causes, reason, marks, coordinates, rows, knots;
    double computed;
} answer_head;
#pragma pack(pop)

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

/* Choose which twists of a long stop become knots: close where it bends, the first and the last one always. Of a very long one
 * only every second, third, ... twist is looked at. */
static int thinned(double (*twists)[6], int count, double dt, double* times, double (*stop)[6]) {
    static double along[MOST_TWISTS];
    const int stride = count / 128 > 1 ? count / 128 : 1, parts = (count - 1) / stride + 1;
    double sum = 0.0, spread, wanted;
    int j, k, i, chosen = 0, last = -1;
    along[0] = 0.0;
    for (j = 1; j < parts; ++j) {
        double bend = 0.0;
        const int before = (j - 1) * stride, here = j * stride, after = here + stride;
        for (i = 0; j + 1 < parts && i < 6; ++i) bend = fmax(bend, fabs(twists[after][i] - 2 * twists[here][i] + twists[before][i]));
        along[j] = sqrt(bend);
        sum += along[j];
    }
    spread = sum / (8 * parts) + 1e-12;
    for (j = 1; j < parts; ++j) along[j] = along[j - 1] + (along[j] + spread);
    for (i = j = 0; i < MOST_KNOTS; ++i) {
        wanted = along[parts - 1] * i / (MOST_KNOTS - 1) * (1 - 1e-12);
        while (j < parts - 1 && along[j] < wanted) ++j;
        k = i + 1 < MOST_KNOTS ? j * stride : count - 1;
        if (k == last) continue;
        last = k;
        times[chosen] = (k + 1) * dt;
        memcpy(stop[chosen++], twists[k], sizeof twists[k]);
    }
    return chosen;
}

/* Write the outputs into the answer, and the stop of the new state with twists of `dt` seconds, or of whole multiples of it if
 * there were more than MOST_TWISTS. Returns how many knots. */
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
    if (most > MOST_TWISTS) {
        const int times_longer = (most - 2) / (MOST_TWISTS - 2) + 1;
        dt *= times_longer;
        most = (most - 2) / times_longer + 3;
    }
    count = ergoqp_stop_twists(state, x->planned, x->sent, x->average, dt, x->acceleration, twists, most);
    if (count > MOST_KNOTS) return thinned(twists, count, dt, times, stop);
    for (k = 0; k < count; ++k) times[k] = (k + 1) * dt;
    memcpy(stop, twists, (size_t)count * sizeof *twists);
    return count;
}

/* Whether a step has no remark: no row is beyond its limit, and pose and posture agree. */
static int plain(const exchange* x) {
    int row;
    for (row = 0; row < x->rows; ++row)
        if (x->results[x->from_margins + row] < -x->tolerance[row]) return 0;
    return x->results[x->from_doubted] < x->doubted;
}

static int at_rest(const exchange* x) {
    const double* state = x->results + x->from_state;
    int i;
    for (i = 0; i < 6 * (x->planned + x->sent); ++i)
        if (state[i] != 0.0) return 0;
    return 1;
}

/* Receive what has arrived of a request, and answer it if it is a plain one.
 *
 * Returns 4 times the number of bytes that arrived, plus what was done with them; -1: nothing arrived yet, -2: the
 * connection has ended. */
int ergoqp_exchange(exchange* x, int client, char* request, int filled) {
    const ssize_t count = recv(client, request + filled, (size_t)(x->request_length - filled), MSG_DONTWAIT);
    request_head asked;
    answer_head head;
    struct timespec from, to;
    double period;
    int most, received, status;

    if (count < 0 && (errno == EAGAIN || errno == EWOULDBLOCK || errno == EINTR)) return -1;
    if (count <= 0) return -2;
    received = 4 * (int)count;
    if (!x->armed || filled + count != x->request_length) return received + RECEIVED;
    memcpy(&asked, request, sizeof asked);
    if (asked.length != (uint32_t)x->request_length || asked.version != x->version || asked.kind != x->ask ||
        asked.session != x->session || asked.acted != x->sequence || asked.sequence <= x->sequence ||
        (asked.problem && asked.problem != x->digest) || asked.followed || asked.contact || asked.coordinates != (uint32_t)x->n ||
        asked.flags & ~(uint32_t)(FRAME | POSE | TWIST | OBSERVED | ENABLE | EXPLAIN))
        return received + RECEIVED;

    clock_gettime(CLOCK_MONOTONIC, &from);
    memcpy(x->given, x->usual, (size_t)x->inputs * sizeof(double));
    memcpy(x->given + x->to_state, x->state, (size_t)x->states * sizeof(double));
    x->request = request;
    if (!ergoqp_take(x, asked.flags, asked.dt, asked.age)) return received + RECEIVED;
    (void)x->step(x->arguments, x->outputs, x->indices, x->work, 0);
    status = (int)x->results[x->from_status];
    if (status > SETTLED || x->results[x->from_causes] != 0.0 || (x->from_drawn >= 0 && x->results[x->from_drawn] != 0.0) ||
        (asked.flags & EXPLAIN && (status != OPTIMAL || !plain(x))))
        return received + COMPUTED;

    period = asked.dt == x->dt || (x->shortest <= asked.dt && asked.dt <= x->longest) ? asked.dt : x->dt;
    most = (int)(x->stop_seconds / period * (1 + 1e-9)) + 2;
    memset(&head, 0, sizeof head);
    head.knots = (uint32_t)ergoqp_tell(x, period, most);
    clock_gettime(CLOCK_MONOTONIC, &to);
    head.length = (uint32_t)x->answer_length, head.version = (uint16_t)x->version, head.kind = (uint16_t)x->told;
    head.session = x->session, head.sequence = asked.sequence, head.engine = (uint16_t)x->engine;
    head.status = (uint32_t)status, head.reason = status == SETTLED ? (uint32_t)x->settled : 0;
    head.marks = at_rest(x) ? (uint32_t)x->still : 0;
    head.coordinates = (uint32_t)x->n, head.rows = (uint32_t)x->rows;
    head.computed = (double)(to.tv_sec - from.tv_sec) + 1e-9 * (double)(to.tv_nsec - from.tv_nsec);
    memcpy(x->answer, &head, sizeof head);
    if (asked.flags & EXPLAIN) memset(x->answer + x->at_text, 0, (size_t)x->text);
    return received + (send(client, x->answer, (size_t)x->answer_length, MSG_DONTWAIT | MSG_NOSIGNAL) == x->answer_length
                           ? SENT
                           : NOT_SENT);
}
