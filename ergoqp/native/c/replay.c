/* Computes recorded steps and measures their times:  replay INPUTS OUTPUTS [PASSES]
 *
 * INPUTS holds one ergoqp_input after the other, in the layout of this program's compiler. Write them from your loop with
 * fwrite(&input, sizeof input, 1, file), or with the structs of the Python wrapper. OUTPUTS gets one ergoqp_output for each.
 * Every pass starts from standstill; the first one warms up. Prints nanoseconds: median, p99, p99.9 and the largest of all
 * calls; then, for the shortest time of every step over the passes, which interruptions do not lengthen, median, p99.9 and
 * the largest.
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
    double *times, *shortest;

    if (count < 3 || passes < 2) {
        fprintf(stderr, "usage: replay INPUTS OUTPUTS [PASSES, at least 2]\n");
        return 2;
    }
    if (!(file = fopen(arguments[1], "rb"))) {
        fprintf(stderr, "%s: cannot be read\n", arguments[1]);
        return 2;
    }
    fseek(file, 0, SEEK_END);
    bytes = ftell(file);
    rewind(file);
    steps = bytes / (long)sizeof(ergoqp_input);
    inputs = malloc((size_t)bytes + 1);
    outputs = malloc((size_t)(steps + 1) * sizeof *outputs);
    times = malloc((size_t)(steps * passes + 1) * sizeof *times);
    shortest = malloc((size_t)(steps + 1) * sizeof *shortest);
    if (!inputs || !outputs || !times || !shortest || steps < 1 || bytes % (long)sizeof(ergoqp_input) || fread(inputs, sizeof *inputs, (size_t)steps, file) != (size_t)steps) {
        fprintf(stderr, "%s: not a file of inputs of this problem\n", arguments[1]);
        return 2;
    }
    fclose(file);

    for (pass = 0; pass < passes; ++pass) {
        ergoqp_init(&stepper);
        for (i = 0; i < steps; ++i) {
            double start = now();
            ergoqp_step(&stepper, &inputs[i], &outputs[i]);
            start = now() - start;
            if (pass == 1 || (pass && start < shortest[i])) shortest[i] = start;
            if (pass) times[timed++] = start;
        }
    }

    if (!(file = fopen(arguments[2], "wb")) || fwrite(outputs, sizeof *outputs, (size_t)steps, file) != (size_t)steps) {
        fprintf(stderr, "%s: cannot be written\n", arguments[2]);
        return 2;
    }
    fclose(file);
    qsort(times, (size_t)timed, sizeof *times, ascending);
    qsort(shortest, (size_t)steps, sizeof *shortest, ascending);
    printf("steps %ld\nmedian_ns %.0f\np99_ns %.0f\np999_ns %.0f\nmax_ns %.0f\n", steps, times[timed / 2], times[timed * 99 / 100],
           times[timed * 999 / 1000], times[timed - 1]);
    printf("shortest_median_ns %.0f\nshortest_p999_ns %.0f\nshortest_max_ns %.0f\n", shortest[steps / 2],
           shortest[steps * 999 / 1000], shortest[steps - 1]);
    return 0;
}
