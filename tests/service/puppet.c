/* The C client on strings: one command a line on standard input, one line of answer each. */
#include "ergoqp_client.h"

#include <stdlib.h>

static ergoqp_client client;
static ergoqp_client_input in;
static ergoqp_client_output out;

static int numbers(double* into, int most) {
    int count = 0;
    const char* word;
    while (count < most && (word = strtok(NULL, " \n")) != NULL) into[count++] = strtod(word, NULL);
    return count;
}

static void print(const double* values, size_t count) {
    size_t i;
    for (i = 0; i < count; ++i) printf(" %a", values[i]);
}

int main(void) {
    static char line[1 << 16];
    static double twists[4096][6];
    while (fgets(line, sizeof line, stdin)) {
        const char* word = strtok(line, " \n");
        double given[64] = {0};
        if (!strcmp(word, "init")) {
            const char* path = strtok(NULL, " \n");
            const char* relay = strtok(NULL, " \n");
            int done;
            numbers(given, 4);
            if (client.dt > 0) ergoqp_client_close(&client);
            done = ergoqp_client_init(&client, path, strcmp(relay, "-") ? relay : NULL, (unsigned)given[0], given[1]);
            client.timeout = given[2];
            client.longest_dt = given[3];
            ergoqp_client_defaults(&in);
            printf("%d", done);
        } else if (!strcmp(word, "limits")) {
            numbers(given, 12);
            ergoqp_client_limits(&client, given, given + 6);
        } else if (!strcmp(word, "explain")) {
            numbers(given, 1);
            client.explain = (int)given[0];
        } else if (!strcmp(word, "timeout")) {
            numbers(&client.timeout, 1);
        } else if (!strcmp(word, "flags")) {
            numbers(given, 1);
            in.flags = (unsigned)given[0];
        } else if (!strcmp(word, "age")) {
            numbers(&in.age, 1);
        } else if (!strcmp(word, "posture")) {
            numbers(in.posture, ERGOQP_CLIENT_MOST_COORDINATES);
        } else if (!strcmp(word, "observed")) {
            numbers(in.observed, ERGOQP_CLIENT_MOST_COORDINATES);
        } else if (!strcmp(word, "pose")) {
            numbers(in.pose, 16);
        } else if (!strcmp(word, "twist")) {
            numbers(in.twist, 6);
        } else if (!strcmp(word, "step") || !strcmp(word, "brake")) {
            int fresh = *word == 's' ? ergoqp_client_step(&client, &in, &out) : ergoqp_client_brake(&client, &out);
            printf("%d %s %u %u %u", fresh, ergoqp_client_status_name(out.status), (unsigned)out.causes,
                   (unsigned)out.marks, (unsigned)out.rows);
            print(out.twist, 6);
            print(&out.cost, 1);
            print(out.posture_rate, client.coordinates);
            print(out.margins, out.rows);
        } else if (!strcmp(word, "reset")) {
            ergoqp_client_reset(&client);
        } else if (!strcmp(word, "take_over")) {
            numbers(given, 6);
            printf("%d", ergoqp_client_take_over(&client, given));
        } else if (!strcmp(word, "hold")) {
            ergoqp_client_hold(&client);
        } else if (!strcmp(word, "try_again")) {
            ergoqp_client_try_again(&client);
        } else if (!strcmp(word, "guide")) {
            numbers(given, 17);
            ergoqp_client_guide(&client, given, given[16]);
        } else if (!strcmp(word, "no_guide")) {
            ergoqp_client_guide(&client, NULL, -1e9);
        } else if (!strcmp(word, "waits")) {
            printf("%d", ergoqp_client_waits(&client));
        } else if (!strcmp(word, "send")) {
            printf("%d", out.send);
        } else if (!strcmp(word, "reason")) {
            printf("%s", ergoqp_client_reason(&client));
        } else if (!strcmp(word, "counters")) {
            printf("%d %d %d", (int)client.late, (int)client.lost, (int)client.refused);
        } else if (!strcmp(word, "relay")) {
            printf("%d %d", client.relay_known, client.relay_stands);
            print(client.relay_twist, 6);
        } else if (!strcmp(word, "stop")) {
            const size_t count = ergoqp_client_stop(&client, twists, 4096);
            print(twists[0], 6 * count);
        } else if (!strcmp(word, "at")) {
            double twist[6];
            numbers(given, 1);
            ergoqp_client_twist_at(&client, given[0], twist);
            print(twist, 6);
        } else if (!strcmp(word, "close")) {
            ergoqp_client_close(&client);
        }
        putchar('\n');
        fflush(stdout);
    }
    return 0;
}
