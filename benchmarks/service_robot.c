/* A robot in a process of its own, with its own clock: w' = (gain s(t - delay) - w) / lag for the sent twist s.
 *
 * It takes datagrams (u64 number, f64 time, f64 twist[6]), writes its state into a file that others map, a record of
 * every millisecond, and one of every twist. If no twist acts for `hold` seconds, it ramps down along a straight line
 * by itself.
 *
 * Arguments: socket state record twists seconds delay lag gain hold linear_acceleration angular_acceleration pose[16];
 * hold < 0: it goes on for ever. */
#define _GNU_SOURCE
#include <errno.h>
#include <fcntl.h>
#include <math.h>
#include <sched.h>
#include <signal.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <time.h>
#include <unistd.h>

#include "service_robot.h"

#define TICK 0.001
#define COMING 4096

typedef struct {
    uint64_t number;
    double time, twist[6];
} message;

typedef struct {
    message sent;
    double acts; /* when it acts */
} waiting;

static volatile sig_atomic_t told_to_end;

static void note_end(int number) {
    (void)number;
    told_to_end = 1;
}

static double now(void) {
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

/* Turn the pose by the rotation vector w, and move it by v, both in the axes of the world. */
static void move(double pose[16], const double v[3], const double w[3]) {
    const double angle = sqrt(w[0] * w[0] + w[1] * w[1] + w[2] * w[2]);
    double turn[3][3], found[3][3];
    int i, j, k;
    for (i = 0; i < 3; ++i) pose[4 * i + 3] += v[i];
    if (angle < 1e-15) return;
    {
        const double x = w[0] / angle, y = w[1] / angle, z = w[2] / angle, c = cos(angle), s = sin(angle), d = 1 - c;
        const double rows[3][3] = {{c + x * x * d, x * y * d - z * s, x * z * d + y * s},
                                   {y * x * d + z * s, c + y * y * d, y * z * d - x * s},
                                   {z * x * d - y * s, z * y * d + x * s, c + z * z * d}};
        memcpy(turn, rows, sizeof turn);
    }
    for (i = 0; i < 3; ++i)
        for (j = 0; j < 3; ++j)
            for (found[i][j] = 0, k = 0; k < 3; ++k) found[i][j] += turn[i][k] * pose[4 * k + j];
    for (i = 0; i < 3; ++i)
        for (j = 0; j < 3; ++j) pose[4 * i + j] = found[i][j];
}

int main(int count, char** argument) {
    static waiting coming[COMING];
    static robot_record record;
    static robot_twist told;
    struct sockaddr_un address;
    struct sched_param first = {50};
    robot_state* shared;
    double delay, lag, gain, hold, acceleration[2], end, begun, heard, pose[16], w[6] = {0}, sent[6] = {0};
    int in, file, i, head = 0, tail = 0, ramps = 0;
    long tick;
    FILE *log, *twists;
    message latest;

    if (count != 28) return 2;
    signal(SIGTERM, note_end);
    (void)sched_setscheduler(0, SCHED_FIFO, &first); /* where it is allowed: a robot has a computer of its own */
    delay = atof(argument[6]), lag = atof(argument[7]), gain = atof(argument[8]), hold = atof(argument[9]);
    acceleration[0] = atof(argument[10]), acceleration[1] = atof(argument[11]);
    for (i = 0; i < 16; ++i) pose[i] = atof(argument[12 + i]);
    in = socket(AF_UNIX, SOCK_DGRAM | SOCK_NONBLOCK, 0);
    memset(&address, 0, sizeof address);
    address.sun_family = AF_UNIX;
    snprintf(address.sun_path, sizeof address.sun_path, "%s", argument[1]);
    if (bind(in, (struct sockaddr*)&address, sizeof address)) return 3;
    file = open(argument[2], O_RDWR | O_CREAT, 0600);
    if (file < 0 || ftruncate(file, sizeof *shared)) return 4;
    shared = mmap(NULL, sizeof *shared, PROT_READ | PROT_WRITE, MAP_SHARED, file, 0);
    if (shared == MAP_FAILED || !(log = fopen(argument[3], "wb"))) return 5;
    if (!(twists = fopen(argument[4], "wb"))) return 5;
    memset(&latest, 0, sizeof latest);

    begun = heard = now();
    end = begun + atof(argument[5]);
    for (tick = 0; begun + (double)tick * TICK < end && !told_to_end; ++tick) {
        const double t = begun + (double)tick * TICK;
        struct timespec due = {(time_t)t, (long)(1e9 * (t - (double)(time_t)t))};
        const double late = now() - t;
        double v[3], turn[3];
        while (late < 0.5 * TICK && clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &due, NULL) == EINTR) continue;
        for (;;) {
            message got;
            if (recv(in, &got, sizeof got, MSG_DONTWAIT) != (ssize_t)sizeof got) break;
            coming[head].sent = latest = got;
            coming[head].acts = t + delay;
            head = (head + 1) % COMING;
        }
        while (tail != head && coming[tail].acts <= t + 1e-9) {
            const message* next = &coming[tail].sent;
            told.time = t, told.number = (double)next->number, told.stamp = next->time, told.ramps = ramps;
            memcpy(told.before, sent, sizeof sent);
            memcpy(told.twist, next->twist, sizeof sent);
            fwrite(&told, sizeof told, 1, twists);
            memcpy(sent, next->twist, sizeof sent);
            tail = (tail + 1) % COMING;
            heard = t, ramps = 0;
        }
        if (hold >= 0 && t - heard > hold) {
            /* Its own ramp: the whole twist is scaled down. */
            double largest = 0, share;
            ramps = 1;
            for (i = 0; i < 6; ++i) largest = fmax(largest, fabs(sent[i]) / acceleration[i / 3]);
            share = largest > TICK ? 1 - TICK / largest : 0;
            for (i = 0; i < 6; ++i) sent[i] *= share;
        }
        for (i = 0; i < 6; ++i) {
            const double goal = gain * sent[i], before = w[i];
            w[i] = lag > 0 ? goal + (w[i] - goal) * exp(-TICK / lag) : goal;
            /* The exact way of a first-order lag within the tick. */
            *(i < 3 ? &v[i] : &turn[i - 3]) =
                goal * TICK + (lag > 0 ? (before - goal) * lag * (1 - exp(-TICK / lag)) : 0);
        }
        move(pose, v, turn);
        record.time = t, record.late = late, record.number = (double)latest.number, record.stamp = latest.time;
        memcpy(record.command, latest.twist, sizeof record.command);
        memcpy(record.executed, sent, sizeof record.executed);
        memcpy(record.velocity, w, sizeof record.velocity);
        memcpy(record.pose, pose, sizeof record.pose);
        fwrite(&record, sizeof record, 1, log);
        __atomic_add_fetch(&shared->version, 1, __ATOMIC_SEQ_CST); /* odd: being written */
        memcpy(shared->pose, pose, sizeof pose);
        memcpy(shared->velocity, w, sizeof w);
        shared->time = t;
        __atomic_add_fetch(&shared->version, 1, __ATOMIC_SEQ_CST);
    }
    fclose(log);
    fclose(twists);
    return 0;
}
