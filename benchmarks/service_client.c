/* Calls of the client in C, or of a bare socket, each after the idling of a rate.
 *
 * Arguments: client|raw socket dt, for raw also the bytes of request and answer. Reads lines "rate count" and writes one line
 * of times [us], as many as were fresh, then how often the object moved. */
#include "ergoqp_client.h"

#include <stdlib.h>

#define MOST 100000

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

int main(int count, char** argument) {
    static ergoqp_client client;
    static ergoqp_client_input in;
    static ergoqp_client_output out;
    static double times[MOST], start[32];
    static char sent[1 << 16], got[1 << 16];
    const int raw = count > 1 && !strcmp(argument[1], "raw");
    size_t asked = 0, told = 0;
    double dt, rate;
    int fd = -1, calls, i, j;

    if (count != (raw ? 6 : 4)) return 2;
    dt = atof(argument[3]);
    if (raw) {
        struct sockaddr_un address;
        asked = (size_t)atol(argument[4]), told = (size_t)atol(argument[5]);
        memset(&address, 0, sizeof address);
        address.sun_family = AF_UNIX;
        snprintf(address.sun_path, sizeof address.sun_path, "%s", argument[2]);
        fd = socket(AF_UNIX, SOCK_STREAM, 0);
        if (connect(fd, (struct sockaddr*)&address, sizeof address)) return 3;
    } else if (!ergoqp_client_init(&client, argument[2], NULL, 32, dt)) {
        return 3;
    }
    client.timeout = 1.0;
    ergoqp_client_defaults(&in);
    for (i = 0; i < 32; ++i)
        if (scanf("%lf", &start[i]) != 1) return 4;
    while (scanf("%lf %d", &rate, &calls) == 2 && calls <= MOST) {
        double due = seconds_now();
        int fresh = 0, moving = 0;
        memcpy(in.posture, start, sizeof start);
        if (!raw) ergoqp_client_reset(&client);
        for (i = 0; i < calls; ++i) {
            double from;
            due += 1 / rate;
            if (seconds_now() < due) sleep_until(due);
            else due = seconds_now();
            from = seconds_now();
            if (raw) {
                size_t have = 0;
                if (send(fd, sent, asked, 0) != (ssize_t)asked) return 5;
                while (have < told) {
                    const ssize_t more = recv(fd, got + have, told - have, 0);
                    if (more <= 0) return 6;
                    have += (size_t)more;
                }
                times[fresh++] = 1e6 * (seconds_now() - from);
                continue;
            }
            if (!ergoqp_client_step(&client, &in, &out)) { /* the machine was busy: it is no call of the door */
                ergoqp_client_reset(&client);
                continue;
            }
            times[fresh++] = 1e6 * (seconds_now() - from);
            for (j = 0; j < 6 && out.twist[j] == 0.0; ++j) continue;
            moving += j < 6;
            for (j = 0; j < 32; ++j) in.posture[j] += dt * out.posture_rate[j];
        }
        printf("%d", moving);
        for (i = 0; i < fresh; ++i) printf(" %.2f", times[i]);
        printf("\n");
        fflush(stdout);
    }
    return 0;
}
