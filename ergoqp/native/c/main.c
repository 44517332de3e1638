/* A loop of ten seconds, in which the model person follows the object exactly. Your loop has a camera and a robot instead.
 *
 * Without arguments it starts at the state of start.h. Arguments NAME=VALUE change entries of it, in radians, or in metres
 * where the state is points. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "ergoqp_step.h"
#include "start.h"

#define SECONDS 10

static ergoqp_stepper stepper; /* static: all the memory there is */

/* The entry of the state that an argument names, and its value; -1 if there is no such entry. */
static int entry_of(const char* argument, double* value) {
    const char* sign = strchr(argument, '=');
    char* end;
    int j;
    if (!sign) return -1;
    *value = strtod(sign + 1, &end);
    if (end == sign + 1 || *end) return -1;
    for (j = 0; j < ERGOQP_COORDINATES; ++j)
        if (strlen(ergoqp_coordinate_names[j]) == (size_t)(sign - argument) &&
            !strncmp(ergoqp_coordinate_names[j], argument, (size_t)(sign - argument)))
            return j;
    return -1;
}

/* Print the reason of the step in words, after the status. */
static void print_reason(const ergoqp_output* output) {
    int i;
    if (output->status == ERGOQP_BRAKING || output->status == ERGOQP_INVALID) {
        for (i = 0; i < ERGOQP_CAUSES; ++i)
            if (output->causes >> i & 1) printf(" %s", ergoqp_cause_names[i]);
        if (output->fault) {
            const char* unit = ergoqp_fault_units[output->fault];
            printf(" (%s", ergoqp_fault_names[output->fault]);
            if (output->fault_amount != 0.0) printf(" %.3g%s%s", output->fault_amount, *unit ? " " : "", unit);
            printf(")");
        }
    }
    for (i = 0; i < ERGOQP_ROWS; ++i)
        if (output->outside[i] > 0.5) printf(" %s outside by %.3g %s;", ergoqp_row_names[i], -output->margins[i], ergoqp_row_units[i]);
    if (output->status == ERGOQP_RELAXED)
        for (i = 0; i < ERGOQP_ROWS; ++i)
            if (output->slack[i] > 1e-6) printf(" %s gives way;", ergoqp_row_names[i]);
    if (output->status == ERGOQP_SETTLED) printf(" moving would gain too little");
}

int main(int count, char** arguments) {
    static const double start[ERGOQP_COORDINATES] = START;
    ergoqp_input input;
    ergoqp_output output;
    double first = 0.0;
    int period, i, last = (int)(SECONDS / ERGOQP_DT + 0.5), shown = (int)(1.0 / ERGOQP_DT + 0.5);

    ergoqp_init(&stepper);
    ergoqp_input_defaults(&input);
    memcpy(input.posture, start, sizeof start);
    for (i = 1; i < count; ++i) {
        double value;
        int j = entry_of(arguments[i], &value);
        if (j < 0) {
            fprintf(stderr, "%s: allowed NAME=VALUE, such as %s=0.5\n", arguments[i], ergoqp_coordinate_names[0]);
            return 2;
        }
        input.posture[j] = value;
    }

    for (period = 0; period <= last; ++period) {
        ergoqp_status status = ergoqp_step(&stepper, &input, &output);
        if (period == 0) first = output.cost;
        if (period % shown == 0) {
            printf("%5.1f s  %-10s cost %5.2f  twist %7.4f %7.4f %7.4f m/s %7.4f %7.4f %7.4f rad/s", period * ERGOQP_DT,
                   ergoqp_status_names[status], output.cost, output.twist[0], output.twist[1], output.twist[2], output.twist[3],
                   output.twist[4], output.twist[5]);
            print_reason(&output);
            printf("\n");
        }
        if (period < last)
            for (i = 0; i < ERGOQP_COORDINATES; ++i) input.posture[i] += output.posture_rate[i] * ERGOQP_DT;
    }
    printf("cost of the posture: %.2f at the start, %.2f after %d s\n", first, output.cost, SECONDS);

    input.frame = 0; /* a lost frame: the object slows down */
    printf("without a frame: %s,", ergoqp_status_names[ergoqp_step(&stepper, &input, &output)]);
    print_reason(&output);
    printf("\n");
    return 0;
}
