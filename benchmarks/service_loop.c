/* A robot's control loop with the client of the service, in a process of its own.
 *
 * The model person follows the share of the twist that the robot really does. A loop prints one line of JSON at its end.
 *
 * Arguments: service relay|- robot state start seconds dt timeout naive standing; `robot` is the socket of the robot's
 * datagrams. `naive`: 1 holds the last twist where no answer comes (the control). `standing`: speed [m/s, rad/s] below which
 * the robot's own report counts as standing. */
#include "ergoqp_client.h"

#include <fcntl.h>
#include <math.h>
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

int main(int count, char** argument) {
    static ergoqp_client client;
    static ergoqp_client_input in;
    static ergoqp_client_output out;
    robot_state robot;
    const robot_state* shared;
    struct sockaddr_un address;
    struct {
        uint64_t number;
        double time, twist[6];
    } told = {0, 0, {0}};
    double dt, end, start, standing, stood = 0, rate[32] = {0}, first_back = -1;
    long fresh = 0, reports = 0;
    int file, to_robot, i, naive, relayed;
    FILE* posture;

    if (count != 11) return 2;
    dt = atof(argument[7]), naive = atoi(argument[9]), standing = atof(argument[10]), relayed = strcmp(argument[2], "-");
    if (!ergoqp_client_init(&client, argument[1], relayed ? argument[2] : NULL, 32, dt)) return 3;
    client.timeout = atof(argument[8]);
    ergoqp_client_defaults(&in);
    if (!(posture = fopen(argument[5], "r"))) return 4;
    for (i = 0; i < 32; ++i)
        if (fscanf(posture, "%lf", &in.posture[i]) != 1) return 4;
    fclose(posture);
    file = open(argument[4], O_RDONLY);
    shared = (const robot_state*)mmap(NULL, sizeof *shared, PROT_READ, MAP_SHARED, file, 0);
    if (file < 0 || shared == MAP_FAILED) return 5;
    to_robot = socket(AF_UNIX, SOCK_DGRAM, 0);
    memset(&address, 0, sizeof address);
    address.sun_family = AF_UNIX;
    snprintf(address.sun_path, sizeof address.sun_path, "%s", argument[3]);

    in.flags |= ERGOQP_CLIENT_FLAG_POSE;
    start = seconds_now();
    end = start + atof(argument[6]);
    for (; start < end; start += dt) {
        double share = 0, size = 0;
        int is_fresh;
        sleep_until(start);
        if (seconds_now() - start > 0.5 * dt) start = seconds_now(); /* the process was stopped, or the machine is busy */
        robot_read(shared, &robot);
        memcpy(in.pose, robot.pose, sizeof in.pose);
        /* The robot reports that it stands: only then, and only if the service does not know. */
        stood = largest(robot.velocity, 6) < standing ? stood + dt : 0;
        if (ergoqp_client_waits(&client) && stood > 0.1) {
            ergoqp_client_reset(&client);
            ++reports;
        }
        is_fresh = ergoqp_client_step(&client, &in, &out);
        if (is_fresh) {
            memcpy(rate, out.posture_rate, sizeof rate);
            memcpy(told.twist, out.twist, sizeof told.twist);
            if (first_back < 0) first_back = seconds_now();
            ++fresh;
        } else if (!naive) {
            memcpy(told.twist, out.twist, sizeof told.twist);
        }
        ++told.number;
        told.time += dt;
        if (!relayed) (void)sendto(to_robot, &told, sizeof told, MSG_DONTWAIT, (struct sockaddr*)&address, sizeof address);
        /* The person follows what the robot does of the twist that the rate belongs to. */
        for (i = 0; i < 6; ++i) share += robot.velocity[i] * out.twist[i], size += out.twist[i] * out.twist[i];
        share = size > 1e-12 ? fmin(fmax(share / size, 0), 1) : 0;
        for (i = 0; i < 32; ++i) in.posture[i] += dt * share * rate[i];
    }
    printf("{\"fresh\": %ld, \"late\": %ld, \"lost\": %ld, \"refused\": %ld, \"reports\": %ld}\n", fresh, (long)client.late,
           (long)client.lost, (long)client.refused, reports);
    ergoqp_client_close(&client);
    return 0;
}
