/* ergoqp relay: executes twists and their stops beside the robot, also when who sends them is late, hangs or dies.
 *
 * The output is piecewise linear: to the twist within one period, or longer where the acceleration limit needs it,
 * then along the knots of the stop, then zero until the next frame is accepted. The line to a twist begins when the
 * one before, or the knot of its stop that the frame continues from, is reached. So frames that come a little earlier
 * or later leave no trace in the output, and its jerk is that of the twists. The output is sent at a fixed rate.
 * Nothing is allocated once it runs. Build it by hand:
 *
 *     ergoqp serve --header > ergoqp_client.h
 *     ergoqp relay --source > relay.c
 *     cc -std=c99 -O2 -o relay relay.c -lm
 */
#include "ergoqp_client.h"

#include <fcntl.h>
#include <math.h>
#include <netdb.h>
#include <netinet/in.h>
#include <sched.h>
#include <signal.h>
#include <stdarg.h>
#include <stdlib.h>
#include <sys/mman.h>
#include <sys/stat.h>

#define USAGE "usage: relay --in PATH [--to unix:PATH | --to udp:HOST:PORT] [--rate HZ] [--fifo PRIORITY]"
#define LEAST_DT 1e-5
#define LONGEST_DT 1.0
#define ROUNDING 1e-6 /* a speed that exceeds its limit by this much is cut off [m/s, rad/s] */
#define STRETCH 1.001 /* a part of a stop that would have to last longer by this factor is refused */
#define MISTAKE 2
#define FIRST 1.75 /* a motion's first twist is reached after so many periods: later ones have that to spare */
#define LEAD 0.5   /* a client that asks now will have its answer in so many periods */
#define AHEAD 1.5  /* a line begins at most so many periods after its frame has come */
#define WAITING 4  /* lines that are executed or wait for their time: no more begin within AHEAD */

typedef ergoqp_client_relay_execute Frame;
typedef ergoqp_client_relay_told Told;

/* What the driver gets. */
typedef struct {
    uint64_t number;
    double time;
    double twist[6];
} Datagram;
ERGOQP_CLIENT_ASSERT(sizeof(Datagram) == 64, datagram_size);

/* What is executed from a time on. */
typedef struct {
    uint64_t session, sequence;
    double joins;     /* when its line begins [s]; until then an earlier one is executed */
    double reach, dt; /* after how long the twist is reached, and period of the stop [s] */
    double rests;     /* after how long the output is zero for good [s] */
    double from[6];
    ergoqp_client_plan plan;
} Executed;

static Executed executed, earlier[WAITING]; /* the newest one, and those before it, newest first */

/* The one client. */
static struct {
    int fd;
    long pid;
    size_t got;
    Frame frame;
} client;

static struct {
    int fd, is_text, delivered;
    struct sockaddr_storage address;
    socklen_t length;
    uint64_t number;
} driver;

static volatile sig_atomic_t told_to_end;

/* Whether a write will not wait. */
static int has_room(int fd) {
    struct pollfd room;
    room.fd = fd;
    room.events = POLLOUT;
    room.revents = 0;
    return poll(&room, 1, 0) == 1;
}

/* Writes a line of the log; it is left out where nobody reads, so that the robot never waits for it. */
static void say(const char* words, ...) {
    char line[512] = "ergoqp relay: ";
    const size_t start = strlen(line);
    size_t length;
    va_list more;
    va_start(more, words);
    vsnprintf(line + start, sizeof line - start - 1, words, more);
    va_end(more);
    length = strlen(line);
    line[length] = '\n';
    if (has_room(STDERR_FILENO) && write(STDERR_FILENO, line, length + 1) < 0) return;
}

static void fail(const char* what, const char* given) {
    say("%s%s", what, given);
    exit(MISTAKE);
}

static double seconds_now(void) {
    static int64_t start;
    const int64_t now = ergoqp_client_priv_now();
    if (!start) start = now;
    return 1e-9 * (double)(now - start);
}

/* ---------------------------------------- the output */

static void output(double now, double twist[6]) {
    const Executed* one = &executed;
    double passed;
    int i;
    for (i = 0; i < WAITING && now < one->joins; ++i) one = earlier + i;
    passed = now - one->joins;
    if (passed >= one->reach) {
        ergoqp_client_priv_at(&one->plan, passed - one->reach, twist);
        return;
    }
    for (i = 0; i < 6; ++i) twist[i] = one->from[i] + (one->plan.twist[i] - one->from[i]) * (passed / one->reach);
}

static int stands(double now) { return now - executed.joins >= executed.rests; }

/* Periods of the stop that have begun. */
static uint32_t begun(double now) {
    const double passed = now - executed.joins - executed.reach;
    if (!executed.plan.knots || passed < 0) return 0;
    return passed / executed.dt < 4e9 ? 1u + (uint32_t)(passed / executed.dt) : 4000000000u;
}

static void send_output(double now) {
    Datagram datagram;
    ssize_t sent;
    size_t length = sizeof datagram;
    datagram.number = driver.number++;
    datagram.time = now;
    output(now, datagram.twist);
    if (driver.is_text) {
        const double* u = datagram.twist;
        char line[256];
        length = (size_t)snprintf(line, sizeof line, "%llu %.6f %.9g %.9g %.9g %.9g %.9g %.9g\n",
                                  (unsigned long long)datagram.number, now, u[0], u[1], u[2], u[3], u[4], u[5]);
        /* A pipe that is full would stop the relay: the line is left out. */
        errno = EAGAIN;
        sent = has_room(driver.fd) ? write(driver.fd, line, length) : -1;
    } else {
        sent = sendto(driver.fd, &datagram, length, MSG_DONTWAIT | MSG_NOSIGNAL, (struct sockaddr*)&driver.address,
                      driver.length);
    }
    if ((sent == (ssize_t)length) != driver.delivered) {
        driver.delivered = !driver.delivered;
        say(driver.delivered ? "the robot's driver takes the twists"
                             : "the robot's driver does not take the twists: %s",
            strerror(errno));
    }
}

/* ---------------------------------------- the frames */

static double largest(const double* numbers, const double* limits) {
    double found = 0.0;
    int i;
    for (i = 0; i < 6; ++i) found = fmax(found, fabs(numbers[i]) / limits[i]);
    return found;
}

static double largest_change(const double* from, const double* to, const double* limits) {
    double change[6];
    int i;
    for (i = 0; i < 6; ++i) change[i] = to[i] - from[i];
    return largest(change, limits);
}

static int refuse(Told* told, uint32_t why, const char* words, ...) {
    va_list more;
    va_start(more, words);
    told->kind = ERGOQP_CLIENT_RELAY_TELL_REFUSED;
    told->why = why;
    vsnprintf(told->text, sizeof told->text, words, more);
    va_end(more);
    return 0;
}

/* Whether the numbers of a frame can be used at all. */
static int is_sound(const Frame* frame, Told* told) {
    const uint32_t why = ERGOQP_CLIENT_RELAY_WHY_NUMBERS;
    const double* last;
    double before = 0.0;
    uint32_t k;
    int i;
    if (!(frame->dt >= LEAST_DT && frame->dt <= LONGEST_DT))
        return refuse(told, why, "dt: it is out of range, allowed 1e-5 to 1 s");
    if (!frame->session || !frame->sequence)
        return refuse(told, why, "session, sequence: got 0, allowed those of an answer");
    if (frame->base < ERGOQP_CLIENT_RELAY_BASE_CONTINUES || frame->base > ERGOQP_CLIENT_RELAY_BASE_MOTION) {
        return refuse(told, why, "base: got %u, allowed 1 to 3", (unsigned)frame->base);
    }
    if (frame->knots < 1 || frame->knots > ERGOQP_CLIENT_KNOTS) {
        return refuse(told, why, "knots: got %u, allowed 1 to %u", (unsigned)frame->knots, ERGOQP_CLIENT_KNOTS);
    }
    for (i = 0; i < 6; ++i) {
        const double a = frame->acceleration[i], v = frame->speed[i];
        if (!(a > 0 && v >= 0 && a - a == 0 && v - v == 0)) {
            return refuse(told, why, "acceleration, speed: axis %d is %g, %g, allowed > 0 and >= 0", i, a, v);
        }
    }
    if (!ergoqp_client_priv_finite(frame->twist, 6) || !ergoqp_client_priv_finite(frame->from, 6) ||
        !ergoqp_client_priv_finite(frame->times, frame->knots) ||
        !ergoqp_client_priv_finite(frame->stop, 6 * frame->knots)) {
        return refuse(told, why, "twist, from or stop: a number is not finite");
    }
    for (k = 0; k < frame->knots; ++k) {
        if (!(frame->times[k] > before))
            return refuse(told, why, "times: knot %u is not later than the one before", (unsigned)k);
        before = frame->times[k];
    }
    last = frame->stop + 6 * (frame->knots - 1);
    for (i = 0; i < 6; ++i) {
        if (last[i] != 0.0) return refuse(told, why, "stop: its last twist is not zero");
    }
    return 1;
}

static void cut_off(double twist[6], const double speed[6]) {
    int i;
    for (i = 0; i < 6; ++i) twist[i] = fmax(-speed[i], fmin(speed[i], twist[i]));
}

/* Cuts off and stretches what exceeds the limits by rounding. Returns whether nothing exceeds them by more. */
static int keeps_limits(Frame* frame, Told* told) {
    const uint32_t why = ERGOQP_CLIENT_RELAY_WHY_LIMITS;
    double allowed[6], before = 0.0, shift = 0.0, *old = frame->twist;
    uint32_t k;
    int i;
    for (i = 0; i < 6; ++i) allowed[i] = frame->speed[i] + ROUNDING;
    if (largest(frame->twist, allowed) > 1) return refuse(told, why, "twist: it is faster than the speed limits");
    cut_off(frame->twist, frame->speed);
    for (k = 0; k < frame->knots; ++k) {
        double* twist = frame->stop + 6 * k;
        const double lasts = frame->times[k] - before;
        double needed;
        if (largest(twist, allowed) > 1)
            return refuse(told, why, "stop: knot %u is faster than the speed limits", (unsigned)k);
        cut_off(twist, frame->speed);
        needed = largest_change(old, twist, frame->acceleration);
        if (needed > lasts * STRETCH + 1e-9) {
            return refuse(told, why, "stop: knot %u needs %.3f s within the acceleration limits, and has %.3f s",
                          (unsigned)k, needed, lasts);
        }
        before = frame->times[k];
        shift += fmax(0.0, needed - lasts);
        frame->times[k] += shift;
        old = twist;
    }
    return 1;
}

/* When the twist is reached that a frame continues from, or the knot of its stop. */
static double ahead(const Frame* frame) { return executed.joins + executed.reach + frame->followed * executed.dt; }

/* Whether a frame continues from what the robot does. */
static int continues(const Frame* frame, double now, Told* told) {
    const uint32_t here = begun(now);
    if (frame->session == executed.session && frame->sequence <= executed.sequence) {
        return refuse(told, ERGOQP_CLIENT_RELAY_WHY_BASE, "sequence: got %llu again, allowed a number above %llu",
                      (unsigned long long)frame->sequence, (unsigned long long)executed.sequence);
    }
    if (frame->base == ERGOQP_CLIENT_RELAY_BASE_REST) {
        if (!stands(now))
            return refuse(told, ERGOQP_CLIENT_RELAY_WHY_MOVES,
                          "it begins at rest, and the robot is still sent a motion");
    } else if (frame->base == ERGOQP_CLIENT_RELAY_BASE_MOTION) {
        double near[6], moves[6];
        int i;
        output(now, moves);
        for (i = 0; i < 6; ++i) near[i] = 2 * frame->dt * frame->acceleration[i];
        if (largest_change(moves, frame->from, near) > 1) {
            return refuse(told, ERGOQP_CLIENT_RELAY_WHY_MOTION, "it takes over another motion than the robot is sent");
        }
    } else if (frame->session != executed.session || frame->acted != executed.sequence) {
        return refuse(told, ERGOQP_CLIENT_RELAY_WHY_BASE,
                      "acted: got answer %llu, and answer %llu of %s session is executed",
                      (unsigned long long)frame->acted, (unsigned long long)executed.sequence,
                      frame->session == executed.session ? "this" : "another");
    } else if (frame->followed < here || frame->followed > here + 1u) {
        return refuse(told, ERGOQP_CLIENT_RELAY_WHY_BASE, "followed: got %u periods of the stop, and %u have begun",
                      (unsigned)frame->followed, (unsigned)here);
    } else if (ahead(frame) > now + AHEAD * frame->dt && !stands(now)) {
        return refuse(told, ERGOQP_CLIENT_RELAY_WHY_BASE,
                      "it comes too early: what it continues from lies %.3f s ahead", ahead(frame) - now);
    }
    return 1;
}

static int is_zero(const double twist[6]) {
    int i;
    for (i = 0; i < 6; ++i) {
        if (twist[i] != 0.0) return 0;
    }
    return 1;
}

/* After how long the output is zero for good. */
static double time_to_rest(void) {
    const ergoqp_client_plan* plan = &executed.plan;
    uint32_t last = plan->knots;
    while (last > 0 && is_zero(plan->stop + 6 * (last - 1))) --last;
    /* Knot `last` is the first of those zeros; the twist is before knot 0. */
    if (last > 0 || !is_zero(plan->twist)) return executed.reach + plan->times[last];
    return is_zero(executed.from) ? 0.0 : executed.reach;
}

static void execute(Frame* frame, double now, Told* told) {
    double joins = now, least = FIRST * frame->dt, from[6];
    if (!is_sound(frame, told) || !keeps_limits(frame, told) || !continues(frame, now, told)) return;
    if (told_to_end) {
        refuse(told, ERGOQP_CLIENT_RELAY_WHY_ENDS, "the relay ends");
        return;
    }
    if (frame->base == ERGOQP_CLIENT_RELAY_BASE_CONTINUES && !stands(now)) {
        /* From a knot of the stop, or the twist itself, which lies ahead. */
        joins = ahead(frame);
        least = frame->dt;
    }
    output(joins, from);
    memmove(earlier + 1, earlier, (WAITING - 1) * sizeof *earlier);
    earlier[0] = executed;
    memcpy(executed.from, from, sizeof from);
    executed.session = frame->session;
    executed.sequence = frame->sequence;
    executed.joins = joins;
    executed.dt = frame->dt;
    executed.reach = fmax(least, largest_change(from, frame->twist, frame->acceleration));
    executed.plan.knots = frame->knots;
    memcpy(executed.plan.twist, frame->twist, sizeof frame->twist);
    memcpy(executed.plan.times, frame->times, sizeof frame->times);
    memcpy(executed.plan.stop, frame->stop, sizeof frame->stop);
    executed.rests = time_to_rest();
    told->kind = ERGOQP_CLIENT_RELAY_TELL_ACCEPTED;
}

static void begin_answer(Told* told, uint64_t number) {
    memset(told, 0, sizeof *told);
    told->length = sizeof *told;
    told->version = ERGOQP_CLIENT_RELAY_VERSION;
    told->kind = ERGOQP_CLIENT_RELAY_TELL_STATUS;
    told->number = number;
}

/* Answers with what is executed now; returns whether the client took the answer. */
static int send_answer(int fd, Told* told) {
    static uint32_t last;
    const double now = seconds_now();
    told->session = executed.session;
    told->sequence = executed.sequence;
    told->begun = begun(now + LEAD * executed.dt);
    told->stands = (uint32_t)stands(now);
    output(now, told->twist);
    if (told->why && told->why != last) say("refused: %s", told->text);
    last = told->why;
    return send(fd, told, sizeof *told, MSG_DONTWAIT | MSG_NOSIGNAL) == (ssize_t)sizeof *told;
}

/* ---------------------------------------- the client */

static void end_client(const char* why) {
    close(client.fd);
    client.fd = -1;
    say("the client (process %ld) %s; the stop goes on", client.pid, why);
}

/* Reads what has arrived, and answers at most one frame. */
static void serve_client(void) {
    Told told;
    const size_t head = offsetof(Frame, session);
    const ssize_t count =
        recv(client.fd, (char*)&client.frame + client.got, sizeof client.frame - client.got, MSG_DONTWAIT);
    size_t whole;
    if (count < 0 && (errno == EAGAIN || errno == EWOULDBLOCK || errno == EINTR)) return;
    if (count <= 0) {
        end_client("has ended its connection");
        return;
    }
    client.got += (size_t)count;
    if (client.got < head) return;
    begin_answer(&told, client.frame.number);
    whole = client.frame.kind == ERGOQP_CLIENT_RELAY_ASK_EXECUTE ? sizeof client.frame : head;
    if (client.frame.version != ERGOQP_CLIENT_RELAY_VERSION) {
        refuse(&told, ERGOQP_CLIENT_RELAY_WHY_FRAME, "version: got %u, allowed %u", (unsigned)client.frame.version,
               ERGOQP_CLIENT_RELAY_VERSION);
    } else if (client.frame.kind != ERGOQP_CLIENT_RELAY_ASK_EXECUTE &&
               client.frame.kind != ERGOQP_CLIENT_RELAY_ASK_STATUS) {
        refuse(&told, ERGOQP_CLIENT_RELAY_WHY_FRAME, "kind: got %u, allowed 1 or 2", (unsigned)client.frame.kind);
    } else if (client.frame.length != whole || client.got > whole) {
        refuse(&told, ERGOQP_CLIENT_RELAY_WHY_FRAME, "frame: got %u bytes, allowed %u, and one frame at a time",
               (unsigned)client.frame.length, (unsigned)whole);
    } else if (client.got < whole) {
        return;
    } else if (whole > head) {
        execute(&client.frame, seconds_now(), &told);
    }
    client.got = 0;
    if (!send_answer(client.fd, &told)) {
        end_client("does not read");
    } else if (told.why == ERGOQP_CLIENT_RELAY_WHY_FRAME) {
        end_client("sent what is no frame");
    }
}

static void accept_client(int listener) {
    struct ucred peer;
    socklen_t length = sizeof peer;
    const int fd = accept4(listener, NULL, NULL, SOCK_NONBLOCK | SOCK_CLOEXEC);
    if (fd < 0) return;
    memset(&peer, 0, sizeof peer);
    if (getsockopt(fd, SOL_SOCKET, SO_PEERCRED, &peer, &length) < 0 || (peer.uid != 0 && peer.uid != getuid())) {
        close(fd);
    } else if (client.fd >= 0) {
        Told told;
        begin_answer(&told, 0);
        refuse(&told, ERGOQP_CLIENT_RELAY_WHY_TAKEN, "process %ld is connected already", client.pid);
        send_answer(fd, &told);
        close(fd);
    } else {
        client.fd = fd;
        client.pid = (long)peer.pid;
        client.got = 0;
        say("process %ld is the client", client.pid);
    }
}

/* ---------------------------------------- the set-up */

static void unix_address(struct sockaddr_un* address, const char* path) {
    memset(address, 0, sizeof *address);
    address->sun_family = AF_UNIX;
    if (!*path || strlen(path) >= sizeof address->sun_path) fail("a socket's path has 1 to 107 bytes, got ", path);
    memcpy(address->sun_path, path, strlen(path) + 1);
}

static int listen_at(const char* path) {
    struct sockaddr_un address;
    struct stat found;
    const int fd = socket(AF_UNIX, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0);
    mode_t usual;
    int bound;
    unix_address(&address, path);
    if (lstat(path, &found) == 0) {
        const int other = socket(AF_UNIX, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0);
        if (!S_ISSOCK(found.st_mode)) fail("--in: there is something else at ", path);
        if (connect(other, (struct sockaddr*)&address, sizeof address) == 0 || errno != ECONNREFUSED) {
            fail("--in: another relay listens at ", path);
        }
        close(other);
        unlink(path);
    }
    usual = umask(0177);
    bound = bind(fd, (struct sockaddr*)&address, sizeof address);
    umask(usual);
    if (bound < 0 || listen(fd, 4) < 0) fail("--in: cannot listen there: ", strerror(errno));
    return fd;
}

static void open_driver(const char* to) {
    driver.delivered = 1;
    if (!to) {
        driver.fd = STDOUT_FILENO;
        driver.is_text = 1;
    } else if (strncmp(to, "unix:", 5) == 0) {
        unix_address((struct sockaddr_un*)&driver.address, to + 5);
        driver.length = sizeof(struct sockaddr_un);
        driver.fd = socket(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC, 0);
    } else if (strncmp(to, "udp:", 4) == 0) {
        struct addrinfo hints, *found = NULL;
        char host[256];
        const char* colon = strrchr(to + 4, ':');
        const size_t length = colon ? (size_t)(colon - (to + 4)) : 0;
        if (length < 1 || length >= sizeof host) fail("--to: allowed unix:PATH or udp:HOST:PORT, got ", to);
        memcpy(host, to + 4, length);
        host[length] = 0;
        memset(&hints, 0, sizeof hints);
        hints.ai_socktype = SOCK_DGRAM;
        if (getaddrinfo(host, colon + 1, &hints, &found) != 0) fail("--to: there is no such host and port: ", to);
        memcpy(&driver.address, found->ai_addr, found->ai_addrlen);
        driver.length = found->ai_addrlen;
        driver.fd = socket(found->ai_family, SOCK_DGRAM | SOCK_CLOEXEC, 0);
        freeaddrinfo(found);
    } else {
        fail("--to: allowed unix:PATH or udp:HOST:PORT, got ", to);
    }
    if (driver.fd < 0) fail("--to: ", strerror(errno));
}

static void run_by_fifo(int priority) {
    struct sched_param wanted;
    memset(&wanted, 0, sizeof wanted);
    wanted.sched_priority = priority;
    if (sched_setscheduler(0, SCHED_FIFO, &wanted) < 0) {
        say("SCHED_FIFO %d is not allowed here (%s): usual scheduling", priority, strerror(errno));
        return;
    }
    say("SCHED_FIFO %d, memory %s", priority, mlockall(MCL_CURRENT | MCL_FUTURE) == 0 ? "locked" : "not locked");
}

static void note_end(int number) {
    (void)number;
    told_to_end = 1;
}

static double number_of(const char* name, const char* text, double least, double most) {
    char* end = NULL;
    const double value = strtod(text, &end);
    if (end == text || *end || !(value >= least && value <= most)) {
        say("%s: got %s, allowed %g to %g", name, text, least, most);
        exit(MISTAKE);
    }
    return value;
}

/* Returns the signals that are let in only while the relay waits. */
static sigset_t prepare_signals(void) {
    static const int ends[] = {SIGTERM, SIGINT, SIGHUP};
    struct sigaction action;
    sigset_t blocked, before;
    size_t i;
    memset(&action, 0, sizeof action);
    action.sa_handler = note_end;
    sigemptyset(&blocked);
    for (i = 0; i < sizeof ends / sizeof *ends; ++i) {
        sigaction(ends[i], &action, NULL);
        sigaddset(&blocked, ends[i]);
    }
    sigprocmask(SIG_BLOCK, &blocked, &before);
    signal(SIGPIPE, SIG_IGN);
    return before;
}

static void run(int listener, double period, const sigset_t* while_waiting) {
    double next = seconds_now();
    for (;;) {
        struct pollfd wanted[2];
        struct timespec wait;
        double now = seconds_now(), left;
        if (now >= next) {
            send_output(now);
            if (told_to_end && stands(now)) return;
            /* Ticks that were missed are left out: what counts is the time. */
            next += period * (1.0 + floor((now - next) / period));
        }
        left = fmax(0.0, next - seconds_now());
        wait.tv_sec = (time_t)left;
        wait.tv_nsec = (long)(1e9 * (left - (double)wait.tv_sec));
        wanted[0].fd = listener;
        wanted[1].fd = client.fd; /* -1 is left out */
        wanted[0].events = wanted[1].events = POLLIN;
        wanted[0].revents = wanted[1].revents = 0;
        if (ppoll(wanted, 2, &wait, while_waiting) <= 0) continue;
        if (wanted[1].revents) serve_client();
        if (wanted[0].revents) accept_client(listener);
    }
}

int main(int count, char** words) {
    const char *path = NULL, *to = NULL;
    double rate = 1000.0;
    int fifo = 0, listener, i;
    sigset_t while_waiting;
    for (i = 1; i < count; i += 2) {
        const char *name = words[i], *value = i + 1 < count ? words[i + 1] : NULL;
        if (!value) fail(USAGE, "");
        if (!strcmp(name, "--in"))
            path = value;
        else if (!strcmp(name, "--to"))
            to = value;
        else if (!strcmp(name, "--rate"))
            rate = number_of(name, value, 1.0, 10000.0);
        else if (!strcmp(name, "--fifo"))
            fifo = (int)number_of(name, value, 1.0, 99.0);
        else
            fail(USAGE "; got ", name);
    }
    if (!path) fail(USAGE "; got no --in", "");
    client.fd = -1;
    while_waiting = prepare_signals();
    open_driver(to);
    listener = listen_at(path);
    if (fifo) run_by_fifo(fifo);
    say("listens at %s, sends %g twists a second", path, rate);
    run(listener, 1.0 / rate, &while_waiting);
    unlink(path);
    say("ends at rest");
    return 0;
}
