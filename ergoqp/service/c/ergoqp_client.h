/* A client of `ergoqp serve` for robots' programs: one header, C99 or C++11 and later, POSIX.
 *
 * Nothing is allocated, nothing is thrown, and no call waits for longer than its timeout. Every answer of the service
 * comes with the stop that was certified with it. If the next answer is late, or the service ends, hangs or is started
 * anew, `ergoqp_client_step` gives the next twist of that stop, and the service is told later what the robot executed.
 *
 *     ergoqp_client client;
 *     ergoqp_client_input in;
 *     ergoqp_client_output out;
 *     ergoqp_client_init(&client, "/run/user/1000/ergoqp/screwing.sock", NULL, 32, 0.01);
 *     ergoqp_client_defaults(&in);
 *     ergoqp_client_reset(&client);                    // the robot stands
 *     for (;;) {                                       // once per period
 *         memcpy(in.posture, measured, 32 * sizeof(double));
 *         ergoqp_client_step(&client, &in, &out);      // 1: fresh; 0: out.twist is the next one of the stop
 *         if (out.send) send_to_robot(out.twist);
 *     }
 *
 * The service never assumes that a robot stands, and neither does this client. So begin with `ergoqp_client_reset`, and
 * call it again once the robot stands if `ergoqp_client_waits` is true.
 *
 * A client belongs to one thread. If this program hangs, nobody follows the stop: let `ergoqp relay` do that, beside
 * the robot, and give its path.
 */
#ifndef ERGOQP_CLIENT_H
#define ERGOQP_CLIENT_H

#ifndef _GNU_SOURCE
#define _GNU_SOURCE /* ppoll */
#endif
#include <errno.h>
#include <poll.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <time.h>
#include <unistd.h>

#if defined(__GLIBC__) && !defined(__USE_GNU)
#error "ergoqp_client.h: include it before other headers, or compile with -D_GNU_SOURCE"
#endif
#if defined(__BYTE_ORDER__) && __BYTE_ORDER__ != __ORDER_LITTLE_ENDIAN__
#error "ergoqp_client.h: the frames are little-endian, and this machine is not"
#endif

#if defined(__cplusplus)
#define ERGOQP_CLIENT_ASSERT(condition, name) static_assert(condition, #name)
#elif defined(__STDC_VERSION__) && __STDC_VERSION__ >= 201112L
#define ERGOQP_CLIENT_ASSERT(condition, name) _Static_assert(condition, #name)
#else
#define ERGOQP_CLIENT_ASSERT(condition, name) typedef char ergoqp_client_assert_##name[(condition) ? 1 : -1]
#endif

#error "this is a part of ergoqp_client.h; `ergoqp serve --header` prints the whole"

/* A loop with more is refused by name. */
#ifndef ERGOQP_CLIENT_MOST_COORDINATES
#define ERGOQP_CLIENT_MOST_COORDINATES 64
#endif
#ifndef ERGOQP_CLIENT_MOST_ROWS
#define ERGOQP_CLIENT_MOST_ROWS 128
#endif

#define ERGOQP_CLIENT_LONGEST_REQUEST ERGOQP_CLIENT_REQUEST_LENGTH(ERGOQP_CLIENT_MOST_COORDINATES, 0)
#define ERGOQP_CLIENT_LONGEST_ANSWER \
    ERGOQP_CLIENT_ANSWER_LENGTH(ERGOQP_CLIENT_MOST_COORDINATES, ERGOQP_CLIENT_MOST_ROWS)
#define ERGOQP_CLIENT_LONGEST_TEXT (ERGOQP_CLIENT_TEXT + 160)

ERGOQP_CLIENT_ASSERT(sizeof(double) == 8, doubles_of_eight_bytes);
ERGOQP_CLIENT_ASSERT(offsetof(ergoqp_client_relay_execute, session) == 2 * sizeof(double), relay_head_of_two_doubles);
ERGOQP_CLIENT_ASSERT(ERGOQP_CLIENT_MOST_COORDINATES > 0, coordinates_are_some);
ERGOQP_CLIENT_ASSERT(ERGOQP_CLIENT_MOST_ROWS > 0, rows_are_some);
ERGOQP_CLIENT_ASSERT(ERGOQP_CLIENT_LONGEST_REQUEST % 8 == 0, request_of_whole_doubles);
ERGOQP_CLIENT_ASSERT(ERGOQP_CLIENT_LONGEST_ANSWER % 8 == 0, answer_of_whole_doubles);
ERGOQP_CLIENT_ASSERT(ERGOQP_CLIENT_LONGEST_ANSWER <= ERGOQP_CLIENT_LONGEST_FRAME, capacities_within_a_frame);

/* What goes into a step. `ergoqp_client_defaults` sets it; fill in what is measured, and set the flag of each. */
typedef struct {
    unsigned flags;  /* ERGOQP_CLIENT_FLAG_FRAME (a posture arrived), _POSE, _TWIST, _OBSERVED and _ENABLE */
    double age;      /* of the posture [s] */
    double pose[16]; /* measured contact frame in the world, row-major 4 x 4 [m] */
    double twist[6]; /* measured twist of the last period [m/s, rad/s] */
    double posture[ERGOQP_CLIENT_MOST_COORDINATES];  /* in the order of the coordinates [rad] */
    double observed[ERGOQP_CLIENT_MOST_COORDINATES]; /* 1 for entries that the sensors see, else 0 */
} ergoqp_client_input;

/* What comes out. If it is not fresh, all but `twist`, `status` and `posture_rate` is that of the last fresh answer. */
typedef struct {
    double twist[6];   /* send this [m/s, rad/s] */
    int fresh;         /* 1: the service answered in time */
    int send;          /* 1: send it; 0: a relay moves the robot, or after a pause it may have slowed down by itself */
    uint32_t status;   /* ERGOQP_CLIENT_STATUS_...; braking if it is not fresh */
    uint32_t causes;   /* bit 1u << ERGOQP_CLIENT_CAUSE_...: what was not used, and why */
    uint32_t reason;   /* number of the reason, 0: none; in words: ergoqp_client_reason */
    uint32_t marks;    /* ERGOQP_CLIENT_MARK_... */
    uint32_t engine;   /* ERGOQP_CLIENT_ENGINE_... */
    uint32_t drawn;    /* phase of the guide; 0: none */
    uint32_t rows;     /* entries of margins and slack */
    double computed;   /* time that the step took in the service [s] */
    double cost, gain; /* V of the posture; predicted improvement within one second at full speed [points] */
    double pose[16];   /* contact frame that the step used, row-major 4 x 4 [m] */
    double posture_rate[ERGOQP_CLIENT_MOST_COORDINATES]; /* how the model person follows [rad/s]; 0 if not fresh */
    double margins[ERGOQP_CLIENT_MOST_ROWS];             /* distance of each row to its nearer end, in its unit */
    double slack[ERGOQP_CLIENT_MOST_ROWS];               /* violation of each row in the QP, in its unit per second */
} ergoqp_client_output;

/* A connection, and how much of an answer it has received. */
typedef struct {
    int fd;
    uint64_t outstanding; /* number of the question that is not answered yet; 0: none */
    size_t got;
} ergoqp_client_link;

/* The twist that is executed, and its stop. */
typedef struct {
    uint32_t knots;
    double twist[6], times[ERGOQP_CLIENT_KNOTS], stop[6 * ERGOQP_CLIENT_KNOTS];
} ergoqp_client_plan;

typedef struct {
    /* Yours to change after ergoqp_client_init. */
    double timeout;    /* how long a call may wait [s]; half a period */
    double longest_dt; /* longest time between two twists [s]; 0: as the service says, 3 periods before it has answered */
    int explain;       /* 1: the service writes reasons in full */
    double speed[6], acceleration[6]; /* limits of a relay's output: those of the service, or of ergoqp_client_limits */

    /* Yours to read. */
    uint64_t late, lost, refused;  /* answers that did not come in time; connections; answers that were not usable */
    int relay_known, relay_stands; /* whether the relay has answered this call, and whether its output is zero */
    double relay_twist[6];         /* output of the relay when it was asked last [m/s, rad/s] */

    /* The rest is the client's own. */
    char path[sizeof(((struct sockaddr_un*)0)->sun_path)], relay_path[sizeof(((struct sockaddr_un*)0)->sun_path)];
    int has_relay, called, paused;
    uint32_t coordinates, followed, begin, holds, place;
    double dt;
    int64_t called_at, returned_at;
    ergoqp_client_link service, relay;
    uint64_t session, sequence, acted, number, pending_session, pending;
    double guide[16], promise, previous[6], current[6], told_longest;
    int own_limits;
    ergoqp_client_plan plan;
    ergoqp_client_output last;
    ergoqp_client_relay_told told;
    double request[ERGOQP_CLIENT_LONGEST_REQUEST / 8], answer[ERGOQP_CLIENT_LONGEST_ANSWER / 8];
    char why[ERGOQP_CLIENT_LONGEST_TEXT];
} ergoqp_client;

/* ---------------------------------------- parts of the calls below */

#define ERGOQP_CLIENT_REPORT "call ergoqp_client_reset once the robot stands, or ergoqp_client_take_over"

static inline int64_t ergoqp_client_priv_now(void) {
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    return (int64_t)now.tv_sec * 1000000000 + now.tv_nsec;
}

static inline int ergoqp_client_priv_finite(const double* numbers, size_t count) {
    size_t i;
    for (i = 0; i < count; ++i) {
        if (!(numbers[i] - numbers[i] == 0.0)) return 0;
    }
    return 1;
}

static inline void ergoqp_client_priv_say(ergoqp_client* c, const char* who, const char* what, const char* more) {
    snprintf(c->why, sizeof c->why, "%s%s%s", who, what, more);
}

static inline void ergoqp_client_priv_disconnect(ergoqp_client_link* link) {
    if (link->fd >= 0) close(link->fd);
    link->fd = -1;
    link->outstanding = 0;
    link->got = 0;
}

/* Connects without waiting; returns whether it worked. */
static inline int ergoqp_client_priv_connect(ergoqp_client_link* link, const char* path) {
    struct sockaddr_un address;
    if (link->fd >= 0) return 1;
    memset(&address, 0, sizeof address);
    address.sun_family = AF_UNIX;
    memcpy(address.sun_path, path, strlen(path) + 1);
    link->fd = socket(AF_UNIX, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0);
    if (link->fd < 0) return 0;
    if (connect(link->fd, (const struct sockaddr*)&address, sizeof address) < 0) {
        ergoqp_client_priv_disconnect(link);
        return 0;
    }
    return 1;
}

/* Sends a whole frame; returns whether it worked. A part of a frame is of no use: the connection is then ended. */
static inline int ergoqp_client_priv_send(ergoqp_client_link* link, const void* frame, size_t length, uint64_t number) {
    if (send(link->fd, frame, length, MSG_DONTWAIT | MSG_NOSIGNAL) != (ssize_t)length) return 0;
    link->outstanding = number;
    link->got = 0;
    return 1;
}

enum {
    ERGOQP_CLIENT_PRIV_NOT_YET,
    ERGOQP_CLIENT_PRIV_WHOLE,
    ERGOQP_CLIENT_PRIV_LOST,
    ERGOQP_CLIENT_PRIV_GARBAGE,
    ERGOQP_CLIENT_PRIV_VERSION,
    ERGOQP_CLIENT_PRIV_TOO_LONG
};

/* Receives the rest of one frame until a time [ns]. All frames begin with length and version. */
static inline int ergoqp_client_priv_receive(ergoqp_client_link* link, void* into, size_t capacity, unsigned version,
                                             int64_t until) {
    char* bytes = (char*)into;
    for (;;) {
        ssize_t count;
        if (link->got >= 8) {
            uint32_t length;
            uint16_t spoken;
            memcpy(&length, bytes, sizeof length);
            memcpy(&spoken, bytes + 4, sizeof spoken);
            /* One question is outstanding, so nothing follows its answer. */
            if (length < 16 || length > ERGOQP_CLIENT_LONGEST_FRAME) return ERGOQP_CLIENT_PRIV_GARBAGE;
            if (spoken != version) return ERGOQP_CLIENT_PRIV_VERSION;
            if (length > capacity) return ERGOQP_CLIENT_PRIV_TOO_LONG;
            if (link->got > length) return ERGOQP_CLIENT_PRIV_GARBAGE;
            if (link->got == length) return ERGOQP_CLIENT_PRIV_WHOLE;
        }
        count = recv(link->fd, bytes + link->got, capacity - link->got, MSG_DONTWAIT);
        if (count > 0) {
            link->got += (size_t)count;
        } else if (count == 0 || (errno != EAGAIN && errno != EWOULDBLOCK && errno != EINTR)) {
            return ERGOQP_CLIENT_PRIV_LOST;
        } else if (errno != EINTR) {
            const int64_t left = until - ergoqp_client_priv_now();
            struct timespec wait;
            struct pollfd poll_for;
            if (left <= 0) return ERGOQP_CLIENT_PRIV_NOT_YET;
            wait.tv_sec = (time_t)(left / 1000000000);
            wait.tv_nsec = (long)(left % 1000000000);
            poll_for.fd = link->fd;
            poll_for.events = POLLIN;
            poll_for.revents = 0;
            ppoll(&poll_for, 1, &wait, NULL);
        }
    }
}

/* Counts and says what was received; returns whether it is an answer. A connection that does not work any more is
 * ended. */
static inline int ergoqp_client_priv_found(ergoqp_client* c, ergoqp_client_link* link, const char* who, int found) {
    static const char* const words[] = {
        "no answer in time",
        "",
        "the connection was lost",
        "an answer that is none",
        "an answer of another version",
        "a longer answer than this client takes; compile it with a larger ERGOQP_CLIENT_MOST_ROWS or _COORDINATES",
    };
    if (found == ERGOQP_CLIENT_PRIV_WHOLE) {
        link->outstanding = 0;
        link->got = 0;
        return 1;
    }
    ergoqp_client_priv_say(c, who, words[found], "");
    if (found == ERGOQP_CLIENT_PRIV_NOT_YET) {
        c->late += 1;
        return 0;
    }
    c->lost += 1;
    c->refused += found == ERGOQP_CLIENT_PRIV_LOST ? 0u : 1u;
    ergoqp_client_priv_disconnect(link);
    return 0;
}

/* Receives the service's answer to the outstanding question; returns whether it is there. */
static inline int ergoqp_client_priv_answer(ergoqp_client* c, int64_t until) {
    int found = ergoqp_client_priv_receive(&c->service, c->answer, sizeof c->answer, ERGOQP_CLIENT_VERSION, until);
    ergoqp_client_answer_head head;
    memcpy(&head, c->answer, offsetof(ergoqp_client_answer_head, engine));
    if (found == ERGOQP_CLIENT_PRIV_WHOLE && head.sequence != c->service.outstanding)
        found = ERGOQP_CLIENT_PRIV_GARBAGE;
    return ergoqp_client_priv_found(c, &c->service, "service: ", found);
}

/* Receives the relay's answer to the outstanding question into `told`; returns whether it is there. */
static inline int ergoqp_client_priv_told(ergoqp_client* c, int64_t until) {
    int found = ergoqp_client_priv_receive(&c->relay, &c->told, sizeof c->told, ERGOQP_CLIENT_RELAY_VERSION, until);
    /* A relay that has a client already says so unasked. */
    const int unasked = c->told.why == ERGOQP_CLIENT_RELAY_WHY_TAKEN && c->told.number == 0;
    if (found == ERGOQP_CLIENT_PRIV_WHOLE &&
        (c->told.length != sizeof c->told || (c->told.number != c->relay.outstanding && !unasked))) {
        found = ERGOQP_CLIENT_PRIV_GARBAGE;
    }
    return ergoqp_client_priv_found(c, &c->relay, "relay: ", found);
}

/* The twist of the plan at a time from its own twist on [s]. */
static inline void ergoqp_client_priv_at(const ergoqp_client_plan* plan, double seconds, double twist[6]) {
    const double *old = plan->twist, *next;
    double before = 0.0;
    uint32_t k = 0;
    int i;
    /* Times that are equal but for rounding are equal, so that the twists of whole periods come out to the bit. */
    while (k < plan->knots && plan->times[k] < seconds * (1 - 1e-12)) ++k;
    if (k >= plan->knots) {
        memset(twist, 0, 6 * sizeof *twist);
        return;
    }
    next = plan->stop + 6 * k;
    if (plan->times[k] <= seconds * (1 + 1e-12)) {
        memcpy(twist, next, 6 * sizeof *twist);
        return;
    }
    if (k > 0) {
        old = plan->stop + 6 * (k - 1);
        before = plan->times[k - 1];
    }
    for (i = 0; i < 6; ++i) twist[i] = old[i] + (next[i] - old[i]) * ((seconds - before) / (plan->times[k] - before));
}

static inline void ergoqp_client_priv_at_followed(const ergoqp_client* c, double twist[6]) {
    ergoqp_client_priv_at(&c->plan, c->followed * c->dt, twist);
}

/* Adds to the number of periods of the stop that were executed. */
static inline void ergoqp_client_priv_pass(ergoqp_client* c, double periods) {
    const double sum = c->followed + periods;
    c->followed = sum < 4e9 ? (uint32_t)sum : 4000000000u;
}

/* Loses the session: from now on the service does not know what the robot does. */
static inline void ergoqp_client_priv_forget(ergoqp_client* c) {
    c->session = 0;
    c->begin = 0;
}

/* Notes that so many seconds have passed since a twist was given, in which the robot went on. Returns whether it is not known
 * any more what the robot does. */
static inline int ergoqp_client_priv_paused(ergoqp_client* c, double seconds) {
    double twist[6];
    int i, moves = c->session || c->begin == ERGOQP_CLIENT_FLAG_TAKES_OVER;
    /* Without a session the robot goes on with the stop. */
    ergoqp_client_priv_at_followed(c, twist);
    for (i = 0; i < 6; ++i) moves |= twist[i] != 0.0;
    if (!moves || c->has_relay) return 0;
    ergoqp_client_priv_forget(c);
    c->paused = 1;
    /* A robot that has a timeout slowed down meanwhile. It must not be sent the speed that it had before. */
    ergoqp_client_priv_pass(c, seconds / c->dt - 1.0);
    snprintf(c->why, sizeof c->why, "%.2f s passed between two twists: %s", seconds, ERGOQP_CLIENT_REPORT);
    return 1;
}

/* Notes the limits that came with the answer that was received. A relay needs them with the first one already. */
static inline void ergoqp_client_priv_note_limits(ergoqp_client* c, uint32_t rows) {
    const uint32_t n = c->coordinates;
    const double longest = c->answer[ERGOQP_CLIENT_ANSWER_AT_LONGEST_DT(n, rows) / 8];
    if (longest > 0) c->told_longest = longest;
    if (!c->own_limits) {
        memcpy(c->speed, c->answer + ERGOQP_CLIENT_ANSWER_AT_SPEED(n, rows) / 8, sizeof c->speed);
        memcpy(c->acceleration, c->answer + ERGOQP_CLIENT_ANSWER_AT_ACCELERATION(n, rows) / 8, sizeof c->acceleration);
    }
}

/* Takes over the answer that was received: from now on it is executed. */
static inline void ergoqp_client_priv_adopt(ergoqp_client* c) {
    ergoqp_client_answer_head head;
    ergoqp_client_output* out = &c->last;
    const uint32_t n = c->coordinates;
    uint32_t m;
    memcpy(&head, c->answer, sizeof head);
    m = head.rows;
    c->session = head.session;
    c->acted = head.sequence;
    c->followed = c->begin = 0;
    c->holds &= ~ERGOQP_CLIENT_FLAG_TRY_AGAIN;
    c->plan.knots = head.knots;
    memcpy(c->plan.twist, head.twist, sizeof c->plan.twist);
    memcpy(c->plan.times, c->answer + ERGOQP_CLIENT_ANSWER_AT_TIMES(n, m) / 8, sizeof c->plan.times);
    memcpy(c->plan.stop, c->answer + ERGOQP_CLIENT_ANSWER_AT_STOP(n, m) / 8, sizeof c->plan.stop);
    memcpy(out->twist, head.twist, sizeof out->twist);
    memcpy(out->pose, head.pose, sizeof out->pose);
    memcpy(out->posture_rate, c->answer + ERGOQP_CLIENT_ANSWER_AT_POSTURE_RATE(n, m) / 8, n * sizeof(double));
    memcpy(out->margins, c->answer + ERGOQP_CLIENT_ANSWER_AT_MARGINS(n, m) / 8, m * sizeof(double));
    memcpy(out->slack, c->answer + ERGOQP_CLIENT_ANSWER_AT_SLACK(n, m) / 8, m * sizeof(double));
    out->cost = c->answer[ERGOQP_CLIENT_ANSWER_AT_COST(n, m) / 8];
    out->gain = c->answer[ERGOQP_CLIENT_ANSWER_AT_GAIN(n, m) / 8];
    out->fresh = 1;
    out->status = head.status;
    out->causes = head.causes;
    out->reason = head.reason;
    out->marks = head.marks;
    out->engine = head.engine;
    out->drawn = head.drawn;
    out->rows = m;
    out->computed = head.computed;
    memset(c->why, 0, sizeof c->why);
    if (head.reason && c->explain) {
        memcpy(c->why, (const char*)c->answer + ERGOQP_CLIENT_ANSWER_AT_TEXT(n, m), ERGOQP_CLIENT_TEXT);
    } else if (head.reason) {
        snprintf(c->why, sizeof c->why, "reason %u", (unsigned)head.reason);
    }
}

/* Whether the answer that was received is a step that can be executed; else says why not. */
static inline int ergoqp_client_priv_usable(ergoqp_client* c) {
    ergoqp_client_answer_head head;
    const double *times, *stop;
    uint32_t length, k;
    const char* wrong = NULL;
    memset(&head, 0, sizeof head);
    memcpy(&length, c->answer, sizeof length);
    memcpy(&head, c->answer, length < sizeof head ? length : sizeof head);
    if (head.kind != ERGOQP_CLIENT_TELL_STEP) {
        /* An answer in words: its head ends with the time that the step took. */
        const size_t start = offsetof(ergoqp_client_answer_head, twist);
        const size_t size = length > start ? length - start : 0;
        char text[ERGOQP_CLIENT_TEXT] = {0};
        memcpy(text, (const char*)c->answer + start, size < sizeof text ? size : sizeof text - 1);
        text[sizeof text - 1] = 0;
        c->refused += 1;
        if (head.kind == ERGOQP_CLIENT_TELL_UNKNOWN) {
            ergoqp_client_priv_forget(c);
            ergoqp_client_priv_say(c, "service: ", text, ": " ERGOQP_CLIENT_REPORT);
        } else {
            ergoqp_client_priv_say(c, "service: ", text, "");
        }
        return 0;
    }
    if (length < sizeof head || head.coordinates != c->coordinates) {
        wrong = "of another number of coordinates";
    } else if (head.rows > ERGOQP_CLIENT_MOST_ROWS) {
        wrong = "of more rows than ERGOQP_CLIENT_MOST_ROWS; compile with a larger one";
    } else if (length != ERGOQP_CLIENT_ANSWER_LENGTH(head.coordinates, head.rows)) {
        wrong = "of another length";
    } else if (head.knots > ERGOQP_CLIENT_KNOTS) {
        wrong = "of too many knots";
    } else {
        double before = 0.0;
        times = c->answer + ERGOQP_CLIENT_ANSWER_AT_TIMES(head.coordinates, head.rows) / 8;
        stop = c->answer + ERGOQP_CLIENT_ANSWER_AT_STOP(head.coordinates, head.rows) / 8;
        if (!ergoqp_client_priv_finite(head.twist, 6) || !ergoqp_client_priv_finite(times, head.knots) ||
            !ergoqp_client_priv_finite(stop, 6 * head.knots)) {
            wrong = "with numbers that are not finite";
        }
        for (k = 0; !wrong && k < head.knots; ++k) {
            if (!(times[k] > before)) wrong = "with a stop whose times do not grow";
            before = times[k];
        }
        for (k = 0; !wrong && head.knots > 0 && k < 6; ++k) {
            if (stop[6 * (head.knots - 1) + k] != 0.0) wrong = "with a stop that does not end at rest";
        }
    }
    if (!wrong) {
        ergoqp_client_priv_note_limits(c, head.rows);
        return 1;
    }
    c->refused += 1;
    ergoqp_client_priv_say(c, "service: an answer ", wrong, "");
    return 0;
}

/* Sends a request and receives its answer; returns whether that is a step which can be executed. */
static inline int ergoqp_client_priv_exchange(ergoqp_client* c, const ergoqp_client_input* in, uint32_t bits,
                                              int64_t until) {
    ergoqp_client_request_head head;
    const uint32_t n = c->coordinates, length = ERGOQP_CLIENT_REQUEST_LENGTH(n, 0);
    if (!ergoqp_client_priv_connect(&c->service, c->path)) {
        c->lost += 1;
        ergoqp_client_priv_say(c, "service: nobody answers at ", c->path, "");
        return 0;
    }
    if (c->service.outstanding) {
        /* An answer that comes now is too late: something else was executed meanwhile. */
        if (!ergoqp_client_priv_answer(c, 0)) return 0;
    }
    memset(&head, 0, sizeof head);
    head.length = length;
    head.version = ERGOQP_CLIENT_VERSION;
    head.kind = ERGOQP_CLIENT_ASK_STEP;
    head.session = c->session;
    head.sequence = ++c->sequence;
    head.coordinates = n;
    head.age = in->age;
    head.dt = c->dt;
    memcpy(head.pose, in->pose, sizeof head.pose);
    memcpy(head.twist, in->twist, sizeof head.twist);
    memcpy(head.guide, c->guide, sizeof head.guide);
    head.promise = c->promise;
    if (c->session) {
        head.acted = c->acted;
        head.followed = c->followed;
    } else if (c->begin == ERGOQP_CLIENT_FLAG_TAKES_OVER) {
        /* Since the measurement the robot has been sent what this client gave for it. */
        ergoqp_client_priv_at_followed(c, head.twist);
        bits |= ERGOQP_CLIENT_FLAG_TAKES_OVER | ERGOQP_CLIENT_FLAG_TWIST;
    } else {
        bits |= c->begin;
    }
    head.flags = bits | c->holds | c->place | (c->explain ? ERGOQP_CLIENT_FLAG_EXPLAIN : 0u);
    memcpy(c->request, &head, sizeof head);
    memcpy(c->request + ERGOQP_CLIENT_REQUEST_AT_POSTURE(n, 0) / 8, in->posture, n * sizeof(double));
    memcpy(c->request + ERGOQP_CLIENT_REQUEST_AT_OBSERVED(n, 0) / 8, in->observed, n * sizeof(double));
    if (!ergoqp_client_priv_send(&c->service, c->request, length, head.sequence)) {
        return ergoqp_client_priv_found(c, &c->service, "service: ", ERGOQP_CLIENT_PRIV_LOST);
    }
    return ergoqp_client_priv_answer(c, until) && ergoqp_client_priv_usable(c);
}

/* Sends a frame to the relay and receives its answer into `told`; returns whether it is there. */
static inline int ergoqp_client_priv_tell_relay(ergoqp_client* c, void* frame, size_t length, int64_t until) {
    const uint64_t number = ++c->number;
    memcpy((char*)frame + offsetof(ergoqp_client_relay_execute, number), &number, sizeof number);
    /* A relay that has a client already says so and closes: nothing can be sent then, but that can be read. */
    const int sent = ergoqp_client_priv_send(&c->relay, frame, length, number);
    if (!ergoqp_client_priv_told(c, sent ? until : 0)) {
        if (!sent) ergoqp_client_priv_disconnect(&c->relay);
        return 0;
    }
    c->told.text[ERGOQP_CLIENT_TEXT - 1] = 0;
    if (c->told.kind == ERGOQP_CLIENT_RELAY_TELL_REFUSED) {
        c->refused += 1;
        ergoqp_client_priv_say(c, "relay: ", c->told.text, "");
        if (c->told.why == ERGOQP_CLIENT_RELAY_WHY_TAKEN) ergoqp_client_priv_disconnect(&c->relay);
    }
    return 1;
}

/* Asks the relay what it executes, and continues from that; returns whether a request can be made. */
static inline int ergoqp_client_priv_ask_relay(ergoqp_client* c, int64_t until) {
    /* The head of a frame is the whole question. */
    double frame[2];
    const uint32_t length = sizeof frame;
    const uint16_t words[2] = {ERGOQP_CLIENT_RELAY_VERSION, ERGOQP_CLIENT_RELAY_ASK_STATUS};
    uint64_t pending;
    c->relay_known = 0;
    if (!ergoqp_client_priv_connect(&c->relay, c->relay_path)) {
        c->lost += 1;
        ergoqp_client_priv_say(c, "relay: nobody answers at ", c->relay_path, "");
        return 0;
    }
    if (c->relay.outstanding && !ergoqp_client_priv_told(c, 0)) return 0;
    memcpy(frame, &length, sizeof length);
    memcpy((char*)frame + 4, words, sizeof words);
    if (!ergoqp_client_priv_tell_relay(c, frame, sizeof frame, until)) return 0;
    if (c->told.kind != ERGOQP_CLIENT_RELAY_TELL_STATUS) return 0;
    c->relay_known = 1;
    c->relay_stands = (int)c->told.stands;
    memcpy(c->relay_twist, c->told.twist, sizeof c->relay_twist);
    pending = c->pending;
    c->pending = 0;
    if (pending && c->told.session == c->pending_session && c->told.sequence == pending) {
        /* It did get the last answer. */
        ergoqp_client_priv_adopt(c);
        c->followed = c->told.begun;
    } else if (c->session && (c->told.session != c->session || c->told.sequence != c->acted)) {
        ergoqp_client_priv_forget(c);
        ergoqp_client_priv_say(c, "relay: it does not execute what was sent to it: ", ERGOQP_CLIENT_REPORT, "");
    } else if (c->session) {
        c->followed = c->told.begun; /* the next line begins where the last of these periods ends */
    }
    return 1;
}

/* Gives the answer that was received to the relay; returns whether it is executed. */
static inline int ergoqp_client_priv_relay(ergoqp_client* c, int64_t until) {
    ergoqp_client_answer_head head;
    ergoqp_client_relay_execute frame;
    const uint32_t n = c->coordinates;
    memcpy(&head, c->answer, sizeof head);
    memset(&frame, 0, sizeof frame);
    frame.length = sizeof frame;
    frame.version = ERGOQP_CLIENT_RELAY_VERSION;
    frame.kind = ERGOQP_CLIENT_RELAY_ASK_EXECUTE;
    frame.session = head.session;
    frame.sequence = head.sequence;
    if (c->session) {
        frame.base = ERGOQP_CLIENT_RELAY_BASE_CONTINUES;
        frame.acted = c->acted;
        frame.followed = c->followed;
    } else if (c->begin == ERGOQP_CLIENT_FLAG_TAKES_OVER) {
        frame.base = ERGOQP_CLIENT_RELAY_BASE_MOTION;
        ergoqp_client_priv_at_followed(c, frame.from);
    } else {
        frame.base = ERGOQP_CLIENT_RELAY_BASE_REST;
    }
    frame.knots = head.knots;
    frame.dt = c->dt;
    memcpy(frame.acceleration, c->acceleration, sizeof frame.acceleration);
    memcpy(frame.speed, c->speed, sizeof frame.speed);
    memcpy(frame.twist, head.twist, sizeof frame.twist);
    memcpy(frame.times, c->answer + ERGOQP_CLIENT_ANSWER_AT_TIMES(n, head.rows) / 8, sizeof frame.times);
    memcpy(frame.stop, c->answer + ERGOQP_CLIENT_ANSWER_AT_STOP(n, head.rows) / 8, sizeof frame.stop);
    /* Until it answers, nobody knows whether it executes this. */
    c->pending = head.sequence;
    c->pending_session = head.session;
    if (!ergoqp_client_priv_tell_relay(c, &frame, sizeof frame, until)) return 0;
    c->pending = 0;
    return c->told.kind == ERGOQP_CLIENT_RELAY_TELL_ACCEPTED;
}

static inline int ergoqp_client_priv_call(ergoqp_client* c, const ergoqp_client_input* in, uint32_t bits,
                                          ergoqp_client_output* out) {
    const int64_t now = ergoqp_client_priv_now(), until = now + (int64_t)(1e9 * c->timeout);
    const double gap = c->called ? 1e-9 * (double)(now - c->called_at) : 0.0;
    const double longest = c->longest_dt > 0 ? c->longest_dt : c->told_longest;
    double since = c->called ? 1e-9 * (double)(now - c->returned_at) : 0.0;
    int64_t end;
    int fresh, paused;
    /* A faster robot is somewhere between two twists: the next line begins there. */
    if (c->called) {
        double there[6];
        int i;
        if (gap < c->dt) {
            for (i = 0; i < 6; ++i) there[i] = c->previous[i] + (c->current[i] - c->previous[i]) * (gap / c->dt);
        } else {
            ergoqp_client_priv_at(&c->plan, c->followed * c->dt + (gap - c->dt), there);
        }
        memcpy(c->previous, there, sizeof there);
    }
    paused = since > longest && ergoqp_client_priv_paused(c, since);
    c->called = 1;
    c->called_at = now;
    fresh = c->has_relay ? ergoqp_client_priv_ask_relay(c, until) : 1;
    fresh = fresh && (c->session || c->begin) && ergoqp_client_priv_exchange(c, in, bits, until);
    fresh = fresh && (!c->has_relay || ergoqp_client_priv_relay(c, until));
    /* This program may have been stopped while it waited. */
    end = ergoqp_client_priv_now();
    since += 1e-9 * (double)(end - now);
    c->returned_at = end;
    if (since > longest && !paused && ergoqp_client_priv_paused(c, since)) fresh = 0;
    if (fresh) {
        ergoqp_client_priv_adopt(c);
    } else {
        ergoqp_client_priv_pass(c, 1.0);
        ergoqp_client_priv_at_followed(c, c->last.twist);
        c->last.fresh = 0;
        c->last.status = ERGOQP_CLIENT_STATUS_BRAKING;
        memset(c->last.posture_rate, 0, sizeof c->last.posture_rate);
    }
    c->last.send = !c->has_relay && !c->paused;
    memcpy(c->current, c->last.twist, sizeof c->current);
    *out = c->last;
    return fresh;
}

/* Begins anew with a plan: from a motion to rest within some seconds. */
static inline void ergoqp_client_priv_begin(ergoqp_client* c, uint32_t how, const double twist[6], double seconds) {
    memset(&c->plan, 0, sizeof c->plan);
    if (twist) {
        memcpy(c->plan.twist, twist, sizeof c->plan.twist);
        c->plan.times[0] = seconds;
        c->plan.knots = 1;
    }
    memcpy(c->previous, c->plan.twist, sizeof c->previous);
    memcpy(c->current, c->plan.twist, sizeof c->current);
    c->session = c->pending = 0;
    c->paused = 0;
    c->followed = c->holds = 0;
    c->begin = how;
    /* From here on the time of a motion counts. A robot that stands may do so for any time. */
    c->called = twist != NULL;
    c->called_at = c->returned_at = ergoqp_client_priv_now();
}

/* ---------------------------------------- the calls */

/* Prepares a client; nothing is sent yet. `path` is the socket of the loop, `relay` that of the relay or NULL, `dt` the
 * period of your loop [s]. Returns 1, or 0 if an argument cannot be used: ergoqp_client_reason says which. */
static inline int ergoqp_client_init(ergoqp_client* c, const char* path, const char* relay, unsigned coordinates,
                                     double dt) {
    memset(c, 0, sizeof *c);
    c->service.fd = c->relay.fd = -1;
    c->dt = dt;
    c->timeout = dt / 2;
    c->told_longest = 3 * dt;
    c->explain = 1;
    c->promise = -1e9;
    ergoqp_client_priv_say(c, "the service was not told yet what the robot does: ", ERGOQP_CLIENT_REPORT, "");
    if (!(dt >= 1e-5 && dt <= 1.0)) {
        ergoqp_client_priv_say(c, "dt: it is out of range, allowed 1e-5 to 1 s", "", "");
    } else if (coordinates < 1 || coordinates > ERGOQP_CLIENT_MOST_COORDINATES) {
        ergoqp_client_priv_say(c, "coordinates: there are none, or more than ERGOQP_CLIENT_MOST_COORDINATES", "", "");
    } else if (strlen(path) >= sizeof c->path || (relay && strlen(relay) >= sizeof c->relay_path)) {
        ergoqp_client_priv_say(c, "path: it is longer than a socket's can be", "", "");
    } else {
        memcpy(c->path, path, strlen(path) + 1);
        if (relay) memcpy(c->relay_path, relay, strlen(relay) + 1);
        c->has_relay = relay != NULL;
        c->coordinates = coordinates;
        return 1;
    }
    return 0;
}

/* Sets other limits for the relay than those that come with the answers [m/s, rad/s; m/s^2, rad/s^2]. They also give the
 * ramp after ergoqp_client_take_over before the service has answered. */
static inline void ergoqp_client_limits(ergoqp_client* c, const double speed[6], const double acceleration[6]) {
    memcpy(c->speed, speed, sizeof c->speed);
    memcpy(c->acceleration, acceleration, sizeof c->acceleration);
    c->own_limits = 1;
}

/* Sets an input: a posture arrived, all of it was seen, the loop is enabled, and nothing else is measured. */
static inline void ergoqp_client_defaults(ergoqp_client_input* in) {
    size_t i;
    memset(in, 0, sizeof *in);
    in->flags = ERGOQP_CLIENT_FLAG_FRAME | ERGOQP_CLIENT_FLAG_ENABLE;
    for (i = 0; i < ERGOQP_CLIENT_MOST_COORDINATES; ++i) in->observed[i] = 1.0;
    for (i = 0; i < 16; i += 5) in->pose[i] = 1.0;
}

/* The next twist, once per period. Returns 1 if it is fresh. 0: it is the next one of the stop that came with the last
 * answer, and ergoqp_client_reason says why. `out` is always filled. */
static inline int ergoqp_client_step(ergoqp_client* c, const ergoqp_client_input* in, ergoqp_client_output* out) {
    const unsigned known = ERGOQP_CLIENT_FLAG_FRAME | ERGOQP_CLIENT_FLAG_POSE | ERGOQP_CLIENT_FLAG_TWIST |
                           ERGOQP_CLIENT_FLAG_OBSERVED | ERGOQP_CLIENT_FLAG_ENABLE;
    return ergoqp_client_priv_call(c, in, in->flags & known, out);
}

/* The next braking twist, without new data; returns as ergoqp_client_step. */
static inline int ergoqp_client_brake(ergoqp_client* c, ergoqp_client_output* out) {
    ergoqp_client_input in;
    ergoqp_client_defaults(&in);
    return ergoqp_client_priv_call(c, &in, ERGOQP_CLIENT_FLAG_BRAKE, out);
}

/* Reports that the robot stands, and begins anew with the next step. */
static inline void ergoqp_client_reset(ergoqp_client* c) {
    ergoqp_client_priv_begin(c, ERGOQP_CLIENT_FLAG_STANDS, NULL, 0.0);
}

/* Reports that the robot moves with a measured twist, and begins anew from there. Returns 0 if it is not finite. Until
 * the service answers, the twists ramp down to zero within the limits that ergoqp_client_limits set, or within one
 * period. */
static inline int ergoqp_client_take_over(ergoqp_client* c, const double twist[6]) {
    double seconds = c->dt;
    int i;
    if (!ergoqp_client_priv_finite(twist, 6)) return 0;
    for (i = 0; i < 6; ++i) {
        const double size = twist[i] < 0 ? -twist[i] : twist[i];
        if (c->acceleration[i] > 0 && size / c->acceleration[i] > seconds) seconds = size / c->acceleration[i];
    }
    ergoqp_client_priv_begin(c, ERGOQP_CLIENT_FLAG_TAKES_OVER, twist, seconds);
    return 1;
}

/* Brings the object to rest and keeps it there until ergoqp_client_try_again or ergoqp_client_reset. */
static inline void ergoqp_client_hold(ergoqp_client* c) { c->holds = ERGOQP_CLIENT_FLAG_HOLD; }

/* Allows motion again after ergoqp_client_hold, after a fault of the robot, and after wrong frames. */
static inline void ergoqp_client_try_again(ergoqp_client* c) { c->holds = ERGOQP_CLIENT_FLAG_TRY_AGAIN; }

/* Has the object drawn to a place, row-major 4 x 4 [m], or to none (NULL), if the loop was started with a guide.
 * `promise` is the expected cost there [points]; -1e9: unknown. */
static inline void ergoqp_client_guide(ergoqp_client* c, const double pose[16], double promise) {
    c->place = pose ? ERGOQP_CLIENT_FLAG_GUIDE : ERGOQP_CLIENT_FLAG_NO_GUIDE;
    if (pose) memcpy(c->guide, pose, sizeof c->guide);
    c->promise = promise;
}

/* Whether the service has to be told what the robot does, by ergoqp_client_reset or ergoqp_client_take_over. */
static inline int ergoqp_client_waits(const ergoqp_client* c) { return !c->session && !c->begin; }

/* Why the last twist is as it is, one sentence; empty for a plain optimal step. */
static inline const char* ergoqp_client_reason(const ergoqp_client* c) { return c->why; }

/* Writes the twists that are left of the stop, one per period, the last one zero; returns how many. */
static inline size_t ergoqp_client_stop(const ergoqp_client* c, double (*twists)[6], size_t most) {
    size_t count = 0;
    while (count < most) {
        double* twist = twists[count++];
        int i, moves = 0;
        ergoqp_client_priv_at(&c->plan, (c->followed + (double)count) * c->dt, twist);
        for (i = 0; i < 6; ++i) moves |= twist[i] != 0.0;
        if (!moves) break;
    }
    return count;
}

/* The twist for a robot that is faster than the loop, at a time since the last step was called [s]: a straight line
 * from where the robot was then to the twist of that step within one period, then on along its stop. The robot is so
 * one period later than a robot that holds each twist: add `dt` to `delay` of the problem's [robot]. */
static inline void ergoqp_client_twist_at(const ergoqp_client* c, double seconds, double twist[6]) {
    int i;
    if (seconds >= c->dt) {
        ergoqp_client_priv_at(&c->plan, c->followed * c->dt + (seconds - c->dt), twist);
        return;
    }
    for (i = 0; i < 6; ++i) {
        const double share = seconds > 0 ? seconds / c->dt : 0.0;
        twist[i] = c->previous[i] + (c->current[i] - c->previous[i]) * share;
    }
}

/* Gives the loop free; the robot has to be at rest. */
static inline void ergoqp_client_close(ergoqp_client* c) {
    ergoqp_client_priv_disconnect(&c->service);
    ergoqp_client_priv_disconnect(&c->relay);
    ergoqp_client_priv_forget(c);
}

#endif
