/* A question of the client in Python and the wait for its answer, in one call: between two of its periods the processor forgets
 * the lines of Python that do the same (`ergoqp.service.stream` and `Answer.wrong`), which then cost some 30 us.
 *
 * It decides nothing that is not plain: what did not come in time, or is no usable step, is left to Python as it arrived. */
#define _GNU_SOURCE
#include <math.h>
#include <poll.h>
#include <stdint.h>
#include <string.h>
#include <sys/socket.h>
#include <time.h>

#define HUGE_SQUARE 1e12

typedef struct {
    const char* request;
    int32_t request_length, answer_length, version, step, statuses;
    int32_t at_sequence, at_status, at_knots, at_twist, at_times, at_stop; /* of the frames [bytes] */
    int32_t numbers, knots;                                     /* doubles from the twist on; most knots */
} asking;

static double now(void) {
    struct timespec time;
    clock_gettime(CLOCK_MONOTONIC, &time);
    return (double)time.tv_sec + 1e-9 * (double)time.tv_nsec;
}

/* The sum of the squares, which is infinite or NaN if any number is. */
static double squares(const double* numbers, int count) {
    double sum = 0.0;
    int i;
    for (i = 0; i < count; ++i) sum += numbers[i] * numbers[i];
    return sum;
}

/* Whether a whole answer is a step whose twist and stop can be executed. */
static int usable(const asking* a, const char* answer) {
    const double *times = (const double*)(answer + a->at_times), *stop = (const double*)(answer + a->at_stop);
    uint32_t length, status, knots, k;
    int i;
    uint16_t version, kind;
    memcpy(&length, answer, sizeof length);
    memcpy(&version, answer + 4, sizeof version);
    memcpy(&kind, answer + 6, sizeof kind);
    memcpy(&status, answer + a->at_status, sizeof status);
    memcpy(&knots, answer + a->at_knots, sizeof knots);
    if (status >= (uint32_t)a->statuses || length != (uint32_t)a->answer_length || version != a->version || kind != a->step || knots > (uint32_t)a->knots ||
        memcmp(answer + a->at_sequence, a->request + a->at_sequence, 8) != 0)
        return 0;
    if (!(squares((const double*)(answer + a->at_twist), a->numbers) < HUGE_SQUARE && squares(times, 7 * a->knots) < HUGE_SQUARE))
        return 0;
    for (k = 0; k < knots; ++k)
        if (!(times[k] > (k ? times[k - 1] : 0.0))) return 0;
    for (i = 0; knots && i < 6; ++i)
        if (stop[6 * (knots - 1) + i] != 0.0) return 0;
    return 1;
}

/* Send the request, and wait until a time of the monotonic clock [s] for the first part of its answer, which is all of it but for
 * rare cases.
 *
 * Returns twice the number of bytes that arrived, plus 1 if they are a usable answer to it; -1 if the request was not sent as a
 * whole. */
int ergoqp_ask(const asking* a, int service, char* answer, double until) {
    struct pollfd arrives = {service, POLLIN, 0};
    struct timespec wait;
    double left;
    ssize_t got;
    if (send(service, a->request, (size_t)a->request_length, MSG_DONTWAIT | MSG_NOSIGNAL) != a->request_length) return -1;
    left = fmax(until - now(), 0.0);
    wait.tv_sec = (time_t)left;
    wait.tv_nsec = (long)(1e9 * (left - (double)wait.tv_sec));
    /* A signal ends this, and Python handles it before it waits on. */
    if (ppoll(&arrives, 1, &wait, NULL) <= 0) return 0;
    got = recv(service, answer, (size_t)a->answer_length, MSG_DONTWAIT);
    /* The end of the connection is seen again by who reads next. */
    return got > 0 ? 2 * (int)got + (got == a->answer_length && usable(a, answer)) : 0;
}
