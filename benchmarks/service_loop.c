/* A robot's control loop with the client of the service, in a process of its own.
 *
 * The model person follows the share of the twist that the robot really does. Every period is recorded.
 *
 * Arguments: service relay|- robot state start record seconds dt timeout longest_dt naive begins standing noise
 * linear_speed angular_speed linear_acceleration angular_acceleration mischief from to hold.
 *
 * - `robot` is the socket of the robot's datagrams.
 * - `longest_dt` and the limits: 0 for those that come with the answers.
 * - `naive`: 1 holds the last twist where no answer comes (the control).
 * - `begins`, if the service does not know what the robot does: 0 waits until the robot stands, 1 takes over what it
 *   was sent last, 2 goes by what the relay sends.
 * - `standing`: speed [m/s, rad/s] below which the robot's report counts as standing.
 * - `hold`: the robot's own timeout; negative: it has none. A robot that has one slows down by itself when this program
 *   pauses for longer or is started anew: it is then sent nothing until it stands.
 * - `mischief`, from `from` to `to` [s], or once at `from`: 1 the posture is NaN; on its own connection 2 random bytes,
 *   3 half a frame, 4 a frame that says it is too long, 5 another version, 6 the same request again, 7 many requests
 *   whose answers nobody reads; in its own requests 8 numbers are skipped, 9 the number of the request before is used
 *   again, 10 `acted` is one less, 11 `followed` is one more, 12 the session is another. */
#include "ergoqp_client.h"

#include <fcntl.h>
#include <math.h>
#include <sched.h>
#include <stdlib.h>
#include <sys/mman.h>

#include "service_robot.h"

static double seconds_now(void) {
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

static void sleep_until(double seconds) {
    struct timespec due;
    due.tv_sec = (time_t)seconds;
    due.tv_nsec = (long)(1e9 * (seconds - (double)due.tv_sec));
    while (clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &due, NULL) == EINTR) continue;
}

static double largest(const double* numbers, int count) {
    double found = 0;
    int i;
    for (i = 0; i < count; ++i) found = fmax(found, fabs(numbers[i]));
    return found;
}

static void* mapped(const char* path, size_t size, int write) {
    const int file = open(path, write ? O_RDWR | O_CREAT | O_TRUNC : O_RDONLY, 0600);
    void* found;
    if (file < 0 || (write && ftruncate(file, (off_t)size))) return NULL;
    found = mmap(NULL, size, write ? PROT_READ | PROT_WRITE : PROT_READ, MAP_SHARED, file, 0);
    return found == MAP_FAILED ? NULL : found;
}

/* Reports what the robot does, if the service has to be told. Returns whether it did. */
static int report(ergoqp_client* client, int begins, double stood, const double sent[6], int has_sent) {
    if (!ergoqp_client_waits(client)) return 0;
    if (stood > 0.05 && (!client->has_relay || (client->relay_known && client->relay_stands))) {
        ergoqp_client_reset(client);
    } else if (begins == 1 && has_sent && largest(sent, 6) > 0) {
        ergoqp_client_take_over(client, sent);
    } else if (begins == 2 && client->relay_known && !client->relay_stands) {
        ergoqp_client_take_over(client, client->relay_twist);
    } else {
        return 0;
    }
    return 1;
}

/* Sends what no client should send. */
static void misbehave(ergoqp_client* client, int mischief) {
    static double frame[ERGOQP_CLIENT_LONGEST_REQUEST / 8];
    ergoqp_client_request_head head;
    const size_t length = ERGOQP_CLIENT_REQUEST_LENGTH(client->coordinates, 0);
    const int to = client->service.fd, how = MSG_DONTWAIT | MSG_NOSIGNAL;
    int i;
    memcpy(frame, client->request, length);
    memcpy(&head, frame, sizeof head);
    switch (mischief) {
        case 2:
            for (i = 0; i < (int)(length / 8); ++i) frame[i] = 1e9 * sin(12.9898 * i + client->sequence);
            break;
        case 4:
            head.length = 1u << 30;
            break;
        case 5:
            head.version = 999;
            break;
        case 8:
            client->sequence += 1000;
            return;
        case 9:
            client->sequence -= 1;
            return;
        case 10:
            client->acted -= 1;
            return;
        case 11:
            client->followed += 1;
            return;
        case 12:
            client->session += 1;
            return;
        default:
            break;
    }
    if (mischief != 2) memcpy(frame, &head, sizeof head);
    for (i = 0; i < (mischief == 7 ? 400 : 1); ++i) {
        if (mischief == 7) {
            head.sequence = ++client->sequence;
            memcpy(frame, &head, sizeof head);
        }
        if (send(to, frame, mischief == 3 ? length / 2 : length, how) < 0) break;
    }
}

int main(int count, char** argument) {
    static ergoqp_client client;
    static ergoqp_client_input in;
    static ergoqp_client_output out;
    const struct sched_param first = {40};
    double limits[4], speed[6], acceleration[6], posture_of[32], sent[6] = {0}, rate[32] = {0};
    robot_state robot;
    const robot_state* shared;
    loop_record* record;
    struct sockaddr_un address;
    struct {
        uint64_t number;
        double time, twist[6];
    } told = {0, 0, {0}};
    double hold, called, dt, begun, end, start, standing, noise, stood = 0, from, to;
    int to_robot, mischief, done = 0, i, naive, begins, relayed, has_sent = 0, silent, period = 0;
    unsigned chance = 12345;
    FILE* posture;

    if (count != 23) return 2;
    (void)sched_setscheduler(0, SCHED_FIFO, &first); /* where it is allowed, as for a robot's program */
    dt = atof(argument[8]), naive = atoi(argument[11]), begins = atoi(argument[12]), standing = atof(argument[13]);
    noise = atof(argument[14]), mischief = atoi(argument[19]), from = atof(argument[20]), to = atof(argument[21]);
    hold = atof(argument[22]), silent = hold >= 0;
    relayed = strcmp(argument[2], "-") != 0;
    if (!ergoqp_client_init(&client, argument[1], relayed ? argument[2] : NULL, 32, dt)) return 3;
    client.timeout = atof(argument[9]);
    client.longest_dt = atof(argument[10]);
    for (i = 0; i < 4; ++i) limits[i] = atof(argument[15 + i]);
    for (i = 0; i < 6; ++i) speed[i] = limits[i / 3], acceleration[i] = limits[2 + i / 3];
    if (limits[0] > 0) ergoqp_client_limits(&client, speed, acceleration);
    ergoqp_client_defaults(&in);
    if (!(posture = fopen(argument[5], "r"))) return 4;
    for (i = 0; i < 32; ++i)
        if (fscanf(posture, "%lf", &posture_of[i]) != 1) return 4;
    fclose(posture);
    shared = (const robot_state*)mapped(argument[4], sizeof *shared, 0);
    record = (loop_record*)mapped(argument[6], LOOP_RECORDS * sizeof *record, 1);
    if (!shared || !record) return 5;
    to_robot = socket(AF_UNIX, SOCK_DGRAM, 0);
    memset(&address, 0, sizeof address);
    address.sun_family = AF_UNIX;
    snprintf(address.sun_path, sizeof address.sun_path, "%s", argument[3]);

    in.flags |= ERGOQP_CLIENT_FLAG_POSE;
    start = begun = called = seconds_now();
    end = start + atof(argument[7]);
    for (; start < end && period < LOOP_RECORDS; start += dt, ++period) {
        loop_record* now = record + period;
        double share = 0, size = 0;
        sleep_until(start);
        /* The process was stopped, or the machine is busy. */
        if (seconds_now() - start > 0.5 * dt) start = seconds_now();
        robot_read(shared, &robot);
        memcpy(in.pose, robot.pose, sizeof in.pose);
        for (i = 0; i < 3; ++i) {
            chance = chance * 1664525u + 1013904223u;
            in.pose[4 * i + 3] += noise * (2.0 * chance / 4294967295.0 - 1);
        }
        for (i = 0; i < 32; ++i)
            in.posture[i] = mischief == 1 && start - begun >= from && start - begun < to ? NAN : posture_of[i];
        stood = largest(robot.velocity, 6) < standing ? stood + dt : 0;
        if (mischief > 1 && !done && start - begun >= from && !ergoqp_client_waits(&client)) {
            misbehave(&client, mischief);
            done = 1;
        }
        now->begins = report(&client, begins, stood, sent, has_sent);
        now->fresh = ergoqp_client_step(&client, &in, &out);
        if (now->fresh > 0) memcpy(rate, out.posture_rate, sizeof rate);
        if (now->fresh > 0 || !naive) memcpy(told.twist, out.twist, sizeof told.twist);
        if (now->begins) silent = 0;
        /* From twist to twist, because this program may have been stopped within the step. */
        if (hold >= 0 && seconds_now() - called > client.longest_dt) silent = 1;
        /* What was answered is then not executed. */
        if (silent && !ergoqp_client_waits(&client)) ergoqp_client_close(&client);
        called = seconds_now();
        ++told.number;
        told.time = start - begun;
        if (!relayed && !silent) {
            (void)sendto(to_robot, &told, sizeof told, MSG_DONTWAIT, (struct sockaddr*)&address, sizeof address);
            memcpy(sent, told.twist, sizeof sent);
            has_sent = 1;
        }
        now->status = out.status, now->reason = out.reason, now->waits = ergoqp_client_waits(&client);
        now->rests = client.plan.knots ? client.plan.times[client.plan.knots - 1] : 0;
        now->late = (double)client.late, now->lost = (double)client.lost, now->refused = (double)client.refused;
        now->number = period + 1, now->moves = largest(robot.velocity, 6), now->known = client.relay_known;
        memcpy(now->twist, told.twist, sizeof now->twist);
        memcpy(now->posture, posture_of, sizeof posture_of);
        now->time = seconds_now();
        /* The person follows what the robot does of the twist that the rate belongs to. */
        for (i = 0; i < 6; ++i) share += robot.velocity[i] * out.twist[i], size += out.twist[i] * out.twist[i];
        share = size > 1e-12 ? fmin(fmax(share / size, 0), 1) : 0;
        for (i = 0; i < 32; ++i) posture_of[i] += dt * share * rate[i];
    }
    ergoqp_client_close(&client);
    return 0;
}
