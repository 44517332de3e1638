/* One control loop around the generated step: the caller's names on one side, the order of the generated function on the
 * other, and the state between two calls. */
#include "ergoqp_step.h"

#include <string.h>

#include "ergoqp_core.h"

static void transposed(double* to, const double* from) {
    int row, column;
    for (row = 0; row < 4; ++row)
        for (column = 0; column < 4; ++column) to[4 * row + column] = from[4 * column + row];
}

void ergoqp_init(ergoqp_stepper* stepper) { memset(stepper, 0, sizeof *stepper); }

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

static void give(ergoqp_stepper* stepper, const ergoqp_input* input) {
    /* Without a frame the last posture still says how the model person follows while the object brakes. */
    if (input->frame) memcpy(GIVEN(posture), input->posture, sizeof input->posture);
    memcpy(GIVEN(observed), input->observed, sizeof input->observed);
    memset(GIVEN(pose), 0, 16 * sizeof(double));
    if (input->has_pose) transposed(GIVEN(pose), input->pose);
    memcpy(GIVEN(executed), input->has_twist ? input->twist : stepper->sent, sizeof stepper->sent);
    memcpy(GIVEN(stored_pose), stepper->stored_pose, sizeof stepper->stored_pose);
    memcpy(GIVEN(sent), stepper->sent, sizeof stepper->sent);
    memcpy(GIVEN(rest), stepper->rest, sizeof stepper->rest);
    *GIVEN(has_pose) = input->has_pose != 0;
    *GIVEN(started) = stepper->started;
    *GIVEN(dt) = input->dt;
    *GIVEN(age) = input->age;
    *GIVEN(frame) = input->frame != 0;
    *GIVEN(enable) = input->enable != 0;
}

static void keep(ergoqp_stepper* stepper, const ergoqp_input* input, int causes) {
    COPY(stepper->sent, FOUND(twist));
    COPY(stepper->stored_pose, FOUND(next_pose));
    COPY(stepper->rest, FOUND(next_rest));
    /* The pose starts from a posture or a pose that could be used; nothing else anchors it. */
    if ((input->frame && !(causes >> ERGOQP_CAUSE_POSTURE & 1)) || (input->has_pose && !(causes >> ERGOQP_CAUSE_POSE & 1)))
        stepper->started = 1.0;
}

ergoqp_status ergoqp_step(ergoqp_stepper* stepper, const ergoqp_input* input, ergoqp_output* output) {
    int i;
    static const int input_at[] = {ERGOQP_INPUT_STARTS};
    static const int output_at[] = {ERGOQP_OUTPUT_STARTS};

    give(stepper, input);
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
    output->qp_residual = FOUND(residuals)[0];
    output->contact = FOUND(residuals)[1];
    output->accepted = FOUND(residuals)[2];
    output->status = (int)*FOUND(status);
    output->causes = (int)*FOUND(causes);
    keep(stepper, input, output->causes);
    return (ergoqp_status)output->status;
}
