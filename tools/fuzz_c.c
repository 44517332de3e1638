/* A fuzz target for the exported step: the bytes of an input are calls with wrong, late and hostile arguments, and every
 * answer is judged. With -fsanitize=fuzzer it is libFuzzer's; with -DSECONDS=N it makes its own bytes for N seconds.
 * Any breach prints one line and aborts. tools/fuzz_c.py builds and runs it.
 */
#include <math.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "ergoqp_step.h"

static const double speed[6] = {ERGOQP_SPEED}, acceleration[6] = {ERGOQP_ACCELERATION};
static const double strange[] = {NAN,  INFINITY, -INFINITY, 1e308,     -1e308, 5e-324, -0.0, 1e200,
                                 1e-5, 0.99e-5,  1e-300,    -1e-9, -1e-3,  1e15,   0.03, 1.0};
#ifdef ERGOQP_SURFACE /* a state that leaps turns the twist along the surface at once, whatever it was */
static const double beyond = 1.0, suddenly = 1e9;
#else
static const double beyond = 1e-9, suddenly = 1e-9;
#endif
static long calls, bytes_left;
static const uint8_t* next;

static void breach(const char* what, double value) {
    fprintf(stderr, "fuzz_c: %s (%g) after %ld calls\n", what, value, calls);
    abort();
}

static unsigned byte(void) { return bytes_left > 0 ? (--bytes_left, *next++) : 0; }

static int one_in(unsigned n) { return byte() % n == 0; }

/* A number around `middle`, or now and then any number at all. */
static double some(double middle, double width) {
    double raw;
    unsigned kind = byte();
    if (kind < 240) return middle + width * ((int)kind - 120) / 120.0;
    if (kind < 250) return strange[byte() % (sizeof strange / sizeof *strange)];
    if (bytes_left < 8) return 0.0;
    memcpy(&raw, next, sizeof raw);
    next += 8;
    bytes_left -= 8;
    return raw;
}

static void finite(const char* what, const double* values, int count) {
    for (; count > 0; --count, ++values)
        if (!isfinite(*values)) breach(what, *values);
}

/* seconds: for how long the twist may have changed; negative: it may be any. */
static void judge(const ergoqp_output* output, const double* before, double seconds) {
    int axis;
    ++calls;
    finite("twist", output->twist, 6);
    finite("pose", output->pose, 16);
    finite("posture_rate", output->posture_rate, ERGOQP_COORDINATES);
    finite("cost", &output->cost, 1);
    for (axis = 0; axis < 6; ++axis) {
        double change = fabs(output->twist[axis] - before[axis]);
        if (fabs(output->twist[axis]) > speed[axis] * (1.0 + beyond)) breach("speed", output->twist[axis]);
        if (seconds >= 0.0 && change > acceleration[axis] * seconds + suddenly)
            breach("acceleration", change / seconds);
    }
    if (output->status < ERGOQP_OPTIMAL || output->status > ERGOQP_INVALID) breach("status", output->status);
    if (output->causes < 0 || output->causes >= 1 << ERGOQP_CAUSES) breach("causes", output->causes);
    if ((output->causes != 0) != (output->status >= ERGOQP_BRAKING)) breach("causes and status", output->causes);
}

static double period(double dt) { return dt >= 1e-5 && dt <= 1.0 ? dt : ERGOQP_DT; }

static void give(ergoqp_input* input, const double* pose) {
    int i;
    ergoqp_input_defaults(input);
    for (i = 0; i < ERGOQP_COORDINATES; ++i) input->posture[i] = (i * 7 % 5 - 2) * 0.1 + 0.01 * (double)(byte() % 64);
    for (i = (int)(byte() % 4); i > 0; --i) input->posture[byte() % ERGOQP_COORDINATES] = some(0.0, 2.0);
    if (one_in(8)) input->observed[byte() % ERGOQP_COORDINATES] = some(0.5, 0.5);
    input->has_pose = one_in(2) ? (int)byte() - 3 : 0;
    memcpy(input->pose, pose, sizeof input->pose);
    for (i = 0; i < 3; ++i) input->pose[4 * i + 3] += some(0.0, 0.002);
    if (one_in(8)) input->pose[byte() % 16] = some(0.0, 1.0);
    input->has_twist = one_in(4);
    for (i = 0; i < 6; ++i) input->twist[i] = some(0.0, 0.3 * speed[i]);
    if (one_in(4)) input->dt = some(ERGOQP_DT, ERGOQP_DT);
    if (one_in(8)) input->age = some(0.05, 0.06);
    input->frame = one_in(8) ? (int)byte() - 128 : 1;
    input->enable = one_in(16) ? (int)byte() - 128 : 1;
}

static void stop_is_what_brake_gives(ergoqp_stepper* stepper) {
    static ergoqp_stepper copy;
    static double twists[ERGOQP_STOP][6], state[ERGOQP_STATE];
    ergoqp_output output;
    int axis, k, count;
    memcpy(state, stepper->state, sizeof state);
    memcpy(&copy, stepper, sizeof copy);
    count = ergoqp_stop(stepper, twists);
    if (count < 1 || count > ERGOQP_STOP) breach("number of twists of a stop", count);
    if (memcmp(state, stepper->state, sizeof state)) breach("a stop changed the state", count);
    for (k = 0; k < count; ++k) {
        ergoqp_brake(&copy, ERGOQP_DT, 0.0, &output);
        for (axis = 0; axis < 6; ++axis)
            if (fabs(output.twist[axis] - twists[k][axis]) > 1e-9) breach("stop and brake", output.twist[axis]);
    }
    for (axis = 0; axis < 6; ++axis)
        if (twists[count - 1][axis] != 0.0) breach("end of a stop", twists[count - 1][axis]);
}

int LLVMFuzzerTestOneInput(const uint8_t* data, size_t size) {
    static ergoqp_stepper stepper, copy;
    ergoqp_input input;
    ergoqp_output output, again;
    double before[6] = {0.0}, twist[6], pose[16], elapsed, dt;
    int axis;
    next = data;
    bytes_left = (long)size;
    for (axis = 0; axis < 16; ++axis) pose[axis] = axis % 5 == 0;
    pose[3] = 0.5;
    pose[7] = -0.1;
    pose[11] = 1.1;
    memset(&output, 0, sizeof output);
    ergoqp_init(&stepper);
    while (bytes_left > 0) {
        unsigned kind = byte() % 32;
        if (kind < 24) {
            give(&input, pose);
            copy = stepper;
            ergoqp_step(&stepper, &input, &output);
            judge(&output, before, period(input.dt));
            if (kind == 0) { /* the same call gives the same answer */
                memset(&again, 0, sizeof again);
                ergoqp_step(&copy, &input, &again);
                if (memcmp(output.twist, again.twist, sizeof again.twist) || output.causes != again.causes)
                    breach("two answers", output.twist[0] - again.twist[0]);
                if (memcmp(stepper.state, copy.state, sizeof copy.state)) breach("two states", 0.0);
            }
        } else if (kind < 28) {
            dt = some(ERGOQP_DT, ERGOQP_DT);
            elapsed = one_in(2) ? some(0.05, 0.1) : 0.0;
            ergoqp_brake(&stepper, dt, elapsed, &output);
            judge(&output, before, elapsed > 0.0 ? -1.0 : period(dt));
        } else if (kind == 28) {
            stop_is_what_brake_gives(&stepper);
            continue;
        } else if (kind == 29) {
            for (axis = 0; axis < 6; ++axis) twist[axis] = some(0.0, speed[axis]);
            if (!ergoqp_take_over(&stepper, twist)) continue;
            for (axis = 0; axis < 6; ++axis) output.twist[axis] = fmax(-speed[axis], fmin(speed[axis], twist[axis]));
        } else if (kind == 30) {
            ergoqp_try_again(&stepper);
        } else {
#ifdef ERGOQP_GUIDE
            double place[16];
            memcpy(place, pose, sizeof place);
            place[byte() % 16] = some(0.5, 0.5);
            (void)ergoqp_guide(&stepper, one_in(4) ? 0 : place, some(2.0, 2.0));
#endif
        }
        memcpy(before, output.twist, sizeof before);
    }
    return 0;
}

#ifdef SECONDS
static uint64_t seed = 88172645463325252ULL;

static uint64_t random_bits(void) {
    seed ^= seed << 13;
    seed ^= seed >> 7;
    return seed ^= seed << 17;
}

int main(void) {
    static uint8_t data[4096];
    const time_t end = time(0) + SECONDS;
    long inputs;
    for (inputs = 0; time(0) < end; ++inputs) {
        size_t size = (size_t)(random_bits() % sizeof data), i;
        for (i = 0; i < size; ++i) data[i] = (uint8_t)(random_bits() >> 24);
        LLVMFuzzerTestOneInput(data, size);
    }
    printf("inputs %ld\ncalls %ld\n", inputs, calls);
    return 0;
}
#else
static void told(void) { fprintf(stderr, "calls %ld\n", calls); }

int LLVMFuzzerInitialize(int* count, char*** arguments) {
    (void)count;
    (void)arguments;
    atexit(told);
    return 0;
}
#endif
