/* A loop of ten seconds: the model person follows the object exactly. Yours has a camera and a robot instead. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "ergoqp_step.h"

static ergoqp_stepper stepper; /* static: all the memory there is */

int main(int count, char** arguments) {
    ergoqp_input input;
    ergoqp_output output;
    int period, i;

    ergoqp_init(&stepper);
    ergoqp_input_defaults(&input);
    /* The start, as NAME=VALUE in radians (metres where the state is points); everything else is zero. */
    for (i = 1; i < count; ++i) {
        char* value = strchr(arguments[i], '=');
        int j;
        if (!value) continue;
        for (j = 0; j < ERGOQP_COORDINATES; ++j)
            if (strlen(ergoqp_coordinate_names[j]) == (size_t)(value - arguments[i]) &&
                !strncmp(ergoqp_coordinate_names[j], arguments[i], (size_t)(value - arguments[i])))
                input.posture[j] = atof(value + 1);
    }

    for (period = 0; period <= (int)(10.0 / ERGOQP_DT); ++period) {
        ergoqp_status status = ergoqp_step(&stepper, &input, &output);
        if (period % (int)(1.0 / ERGOQP_DT) == 0)
            printf("%5.1f s  %-10s cost %5.2f  twist %7.4f %7.4f %7.4f m/s %7.4f %7.4f %7.4f rad/s\n", period * ERGOQP_DT,
                   ergoqp_status_names[status], output.cost, output.twist[0], output.twist[1], output.twist[2], output.twist[3],
                   output.twist[4], output.twist[5]);
        for (i = 0; i < ERGOQP_COORDINATES; ++i) input.posture[i] += output.posture_rate[i] * ERGOQP_DT;
    }

    input.frame = 0; /* a lost frame: the object slows down */
    printf("without a frame: %s\n", ergoqp_status_names[ergoqp_step(&stepper, &input, &output)]);
    return 0;
}
