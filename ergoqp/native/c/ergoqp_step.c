/* One control loop around the generated step: it translates between the caller's names and the order of the generated
 * function, and keeps the state between two calls. */
#include "ergoqp_step.h"

#include <math.h>
#include <string.h>

#include "ergoqp_core.h"
#include "stop.h"

static void transposed(double* to, const double* from) {
    int row, column;
    for (row = 0; row < 4; ++row)
        for (column = 0; column < 4; ++column) to[4 * row + column] = from[4 * column + row];
}

static const double initial[ERGOQP_STATE] = {ERGOQP_INITIAL_STATE};
static const double speed[6] = {ERGOQP_SPEED};

void ergoqp_init(ergoqp_stepper* stepper) {
#ifdef ERGOQP_GUIDE
    static const double place[18] = {ERGOQP_GUIDE};
#endif
    memset(stepper, 0, sizeof *stepper);
    memcpy(stepper->state, initial, sizeof initial);
#ifdef ERGOQP_GUIDE
    memcpy(stepper->guide, place, sizeof place);
#endif
}

int ergoqp_take_over(ergoqp_stepper* stepper, const double twist[6]) {
    static const double taken[ERGOQP_STATE] = {ERGOQP_TAKEN_STATE};
    int axis, i, moves = 0;
    double moving[6];
    for (axis = 0; axis < 6; ++axis) {
        if (!isfinite(twist[axis])) return 0;
        moving[axis] = fmin(fmax(twist[axis], -speed[axis]), speed[axis]);
        moves = moves || moving[axis] != 0.0;
    }
    ergoqp_init(stepper);
    memcpy(stepper->state, taken, sizeof taken);
    if (moves) stepper->state[ERGOQP_STATE_AT_idle] = 0.0;
    /* What a late robot still has to do was not measured, along each axis and against it. */
    for (axis = 0; axis < 6; ++axis) {
        stepper->state[ERGOQP_STATE_AT_due + axis] = ERGOQP_LATE * fmax(moving[axis], 0.0);
        stepper->state[ERGOQP_STATE_AT_due + 6 + axis] = ERGOQP_LATE * fmax(-moving[axis], 0.0);
    }
    /* The history of an object that has always moved at this twist. */
    for (i = 0; i < ERGOQP_PLANNED; ++i) memcpy(stepper->state + 6 * i, moving, sizeof moving);
    for (i = 0; i < ERGOQP_SENT; ++i) memcpy(stepper->state + 6 * (ERGOQP_PLANNED + i), moving, sizeof moving);
    return 1;
}

void ergoqp_input_defaults(ergoqp_input* input) {
    int i;
    memset(input, 0, sizeof *input);
    for (i = 0; i < ERGOQP_COORDINATES; ++i) input->observed[i] = 1.0;
    input->dt = ERGOQP_DT;
    input->frame = 1;
    input->enable = 1;
}

#define GIVEN(name) (stepper->input + ERGOQP_INPUT_AT_##name)
#define FOUND(name) (stepper->output + ERGOQP_OUTPUT_AT_##name)
#define COPY(to, from) memcpy((to), (from), sizeof(to))

static void give(ergoqp_stepper* stepper, const ergoqp_input* input, double ask) {
    /* Without a frame, the state has the last posture. */
    if (input->frame) memcpy(GIVEN(posture), input->posture, sizeof input->posture);
    memcpy(GIVEN(observed), input->observed, sizeof input->observed);
    memset(GIVEN(pose), 0, 16 * sizeof(double));
    memset(GIVEN(executed), 0, 6 * sizeof(double));
    if (input->has_pose) transposed(GIVEN(pose), input->pose);
    if (input->has_twist) memcpy(GIVEN(executed), input->twist, sizeof input->twist);
    memcpy(GIVEN(state), stepper->state, sizeof stepper->state);
    *GIVEN(has_pose) = input->has_pose != 0;
    *GIVEN(has_twist) = input->has_twist != 0;
    *GIVEN(dt) = input->dt;
    *GIVEN(age) = input->age;
    *GIVEN(frame) = input->frame != 0;
    *GIVEN(enable) = input->enable != 0;
    *GIVEN(ask) = ask;
#ifdef ERGOQP_GUIDE
    memcpy(GIVEN(guide), stepper->guide, 16 * sizeof(double));
    *GIVEN(guided) = stepper->guide[16];
    *GIVEN(promise) = stepper->guide[17];
#endif
}

static ergoqp_status answer(ergoqp_stepper* stepper, const ergoqp_input* input, double ask, ergoqp_output* output) {
    int i;
    static const int input_at[] = {ERGOQP_INPUT_STARTS};
    static const int output_at[] = {ERGOQP_OUTPUT_STARTS};

    give(stepper, input, ask);
    for (i = 0; i < (int)(sizeof input_at / sizeof *input_at); ++i) stepper->arg[i] = stepper->input + input_at[i];
    for (i = 0; i < (int)(sizeof output_at / sizeof *output_at); ++i) stepper->res[i] = stepper->output + output_at[i];
    (void)ergoqp_core(stepper->arg, stepper->res, stepper->iw, stepper->w, 0);

    COPY(output->twist, FOUND(twist));
    transposed(output->pose, FOUND(pose_used));
    COPY(output->posture_rate, FOUND(posture_rate));
    output->cost = *FOUND(cost);
    output->gain = *FOUND(gain);
    memcpy(output->margins, FOUND(margins), ERGOQP_ROWS * sizeof(double));
    memcpy(output->slack, FOUND(slack), ERGOQP_ROWS * sizeof(double));
    memcpy(output->multipliers, FOUND(multipliers), ERGOQP_ROWS * sizeof(double));
    memcpy(output->outside, FOUND(outside), ERGOQP_ROWS * sizeof(double));
    COPY(output->locked, FOUND(locked));
    COPY(output->amiss, FOUND(amiss));
    output->qp_residual = FOUND(residuals)[0];
    output->contact = FOUND(residuals)[1];
    output->accepted = FOUND(residuals)[2];
    output->status = (int)*FOUND(status);
    output->causes = (int)*FOUND(causes);
    output->fault = (int)FOUND(fault)[0];
    output->fault_amount = FOUND(fault)[1];
    output->doubted = FOUND(frames)[2] >= ERGOQP_DOUBTED;
    output->apart = FOUND(frames)[4];
    output->apart_angle = FOUND(frames)[5];
#ifdef ERGOQP_GUIDE
    output->drawn = (int)*FOUND(drawn);
#endif
    memcpy(stepper->state, FOUND(next_state), sizeof stepper->state);
    return (ergoqp_status)output->status;
}

ergoqp_status ergoqp_step(ergoqp_stepper* stepper, const ergoqp_input* input, ergoqp_output* output) {
    return answer(stepper, input, 0.0, output);
}

ergoqp_status ergoqp_brake(ergoqp_stepper* stepper, double dt, double elapsed, ergoqp_output* output) {
    ergoqp_input nothing;
    int axis;
    ergoqp_input_defaults(&nothing);
    nothing.frame = 0;
    nothing.enable = 0; /* the robot's own ramp is not checked, and the object rests before it moves again */
    if (!(elapsed >= -ERGOQP_CLOCK_ROUNDING)) nothing.age = NAN; /* an age like that of a frame */
    if (elapsed > ERGOQP_LONGEST_STOP) elapsed = ERGOQP_LONGEST_STOP;
    while (elapsed >= ERGOQP_SHORTEST_PERIOD) {
        nothing.dt = elapsed < ERGOQP_DT ? elapsed : ERGOQP_DT; /* as ergoqp_stop gives them */
        elapsed -= nothing.dt;
        (void)answer(stepper, &nothing, 1.0, output);
        for (axis = 0; axis < 6 && output->twist[axis] == 0.0; ++axis) continue;
        if (axis == 6) break; /* it has stopped */
    }
    nothing.dt = dt;
    nothing.enable = 1;
    return answer(stepper, &nothing, 1.0, output);
}

int ergoqp_stop(ergoqp_stepper* stepper, double twists[ERGOQP_STOP][6]) {
#ifdef ERGOQP_SURFACE
    double kept[ERGOQP_STATE];
    ergoqp_input nothing;
    ergoqp_output output;
    int axis = 0, count = 0;
    ergoqp_input_defaults(&nothing);
    nothing.frame = 0;
    nothing.enable = 0;
    memcpy(kept, stepper->state, sizeof kept);
    while (axis < 6 && count < ERGOQP_STOP) {
        (void)answer(stepper, &nothing, 1.0, &output);
        COPY(twists[count], output.twist);
        for (axis = 0; axis < 6 && output.twist[axis] == 0.0; ++axis) continue;
        ++count;
    }
    memcpy(stepper->state, kept, sizeof kept);
    return count;
#else
    static const double acceleration[6] = {ERGOQP_ACCELERATION};
    return ergoqp_stop_twists(stepper->state, ERGOQP_PLANNED, ERGOQP_SENT, ERGOQP_AVERAGE, ERGOQP_DT, acceleration, twists,
                              ERGOQP_STOP);
#endif
}

void ergoqp_try_again(ergoqp_stepper* stepper) {
    stepper->state[ERGOQP_STATE_AT_latched] = 0.0;
#ifdef ERGOQP_STATE_AT_frames
    stepper->state[ERGOQP_STATE_AT_frames + 1] = 0.0; /* what says that they are wrong */
    stepper->state[ERGOQP_STATE_AT_frames + 2] = 0.0;
#endif
#ifdef ERGOQP_GUIDE
    memset(stepper->state + ERGOQP_STATE_AT_trial, 0, ERGOQP_TRIAL * sizeof(double));
#endif
}

#ifdef ERGOQP_GUIDE
/* Tolerance of a rotation; a position must be within 100 m. */
#define STRAIGHT 1e-3

static int rigid(const double* pose) {
    static const double last[4] = {0.0, 0.0, 0.0, 1.0};
    int i, j, k;
    double dot, turns;
    for (i = 0; i < 16; ++i)
        if (!isfinite(pose[i])) return 0;
    for (i = 0; i < 4; ++i)
        if (fabs(pose[12 + i] - last[i]) > STRAIGHT) return 0;
    for (i = 0; i < 3; ++i)
        if (fabs(pose[4 * i + 3]) > 100.0) return 0;
    for (i = 0; i < 3; ++i)
        for (j = 0; j < 3; ++j) {
            for (dot = 0.0, k = 0; k < 3; ++k) dot += pose[4 * k + i] * pose[4 * k + j];
            if (fabs(dot - (i == j)) > STRAIGHT) return 0;
        }
    turns = pose[0] * (pose[5] * pose[10] - pose[6] * pose[9]) - pose[1] * (pose[4] * pose[10] - pose[6] * pose[8]) +
            pose[2] * (pose[4] * pose[9] - pose[5] * pose[8]);
    return turns > 0.0;
}

int ergoqp_guide(ergoqp_stepper* stepper, const double* place, double promise) {
    if (place && (!rigid(place) || !isfinite(promise))) return 0;
    memset(stepper->state + ERGOQP_STATE_AT_trial, 0, ERGOQP_TRIAL * sizeof(double));
    if (place) transposed(stepper->guide, place);
    stepper->guide[16] = place != 0;
    stepper->guide[17] = place ? promise : 0.0;
    return 1;
}
#endif
