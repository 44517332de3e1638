/* Answers recorded steps and times them:  replay INPUTS OUTPUTS [PASSES]
 *
 * INPUTS holds one ergoqp_input after the other, as this program's compiler lays them out; OUTPUTS gets one ergoqp_output for
 * each. Every pass starts from standstill; the first one warms up. Prints nanoseconds: one line for each step of the last
 * passes is too much to read, so median, p99, p99.9 and the largest of all.
 */
#define _POSIX_C_SOURCE 199309L
#include <stdio.h>
#include <stdlib.h>
#include <time.h>

#include "ergoqp_step.h"

static ergoqp_stepper stepper;

static double now(void) {
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return 1e9 * (double)t.tv_sec + (double)t.tv_nsec;
}

static int ascending(const void* a, const void* b) {
    double x = *(const double*)a, y = *(const double*)b;
    return (x > y) - (x < y);
}

int main(int count, char** arguments) {
    FILE* file;
    long bytes, steps, passes = count > 3 ? atol(arguments[3]) : 2, timed = 0, pass, i;
    ergoqp_input* inputs;
    ergoqp_output* outputs;
    double* times;

    if (count < 3 || passes < 2 || !(file = fopen(arguments[1], "rb"))) {
        fprintf(stderr, "usage: replay INPUTS OUTPUTS [PASSES, at least 2]\n");
        return 2;
    }
    fseek(file, 0, SEEK_END);
    bytes = ftell(file);
    rewind(file);
    steps = bytes / (long)sizeof(ergoqp_input);
    inputs = malloc((size_t)bytes + 1);
    outputs = malloc((size_t)(steps + 1) * sizeof *outputs);
    times = malloc((size_t)(steps * passes + 1) * sizeof *times);
    if (!inputs || !outputs || !times || steps < 1 || fread(inputs, sizeof *inputs, (size_t)steps, file) != (size_t)steps) {
        fprintf(stderr, "%s: not a file of inputs of this problem\n", arguments[1]);
        return 2;
    }
    fclose(file);

    for (pass = 0; pass < passes; ++pass) {
        ergoqp_init(&stepper);
        for (i = 0; i < steps; ++i) {
            double start = now();
            ergoqp_step(&stepper, &inputs[i], &outputs[i]);
            if (pass) times[timed++] = now() - start;
        }
    }

    if (!(file = fopen(arguments[2], "wb")) || fwrite(outputs, sizeof *outputs, (size_t)steps, file) != (size_t)steps) {
        fprintf(stderr, "%s: cannot be written\n", arguments[2]);
        return 2;
    }
    fclose(file);
    qsort(times, (size_t)timed, sizeof *times, ascending);
    printf("steps %ld\nmedian_ns %.0f\np99_ns %.0f\np999_ns %.0f\nmax_ns %.0f\n", steps, times[timed / 2], times[timed * 99 / 100],
           times[timed * 999 / 1000], times[timed - 1]);
    return 0;
}
