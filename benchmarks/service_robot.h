/* What the simulated robot shares with its loop, and what it records. */
#ifndef SERVICE_ROBOT_H
#define SERVICE_ROBOT_H

#include <stdint.h>
#include <string.h>

typedef struct {
    uint64_t version; /* odd while the rest is written */
    double time, pose[16], velocity[6];
} robot_state;

/* Every millisecond; `late`: how late it was computed. */
typedef struct {
    double time, late, number, stamp, command[6], executed[6], velocity[6], pose[16];
} robot_record;

/* Every twist as it begins to act. `before` is what was executed until then, `ramps`: that was the robot's own ramp. */
typedef struct {
    double time, number, stamp, ramps, before[6], twist[6];
} robot_twist;

/* Every period of the loop, in a file that it maps, so that nothing is lost when it is killed. `rests`: how long the
 * stop of the last fresh answer takes; `known`: whether the relay answered; `moves`: largest entry of the robot's
 * own report. */
typedef struct {
    double time, number, fresh, status, reason, waits, begins, rests, late, lost, refused, known, moves;
    double twist[6], posture[32];
} loop_record;
#define LOOP_RECORDS 4096

/* Read the whole state of one moment. */
static inline void robot_read(const robot_state* shared, robot_state* found) {
    for (;;) {
        const uint64_t before = __atomic_load_n(&shared->version, __ATOMIC_SEQ_CST);
        memcpy(found, (const void*)shared, sizeof *found);
        if (!(before & 1) && before == __atomic_load_n(&shared->version, __ATOMIC_SEQ_CST)) return;
    }
}

#endif
