/* What the simulated robot shares with its loop, and what it records. */
#ifndef SERVICE_ROBOT_H
#define SERVICE_ROBOT_H

#include <stdint.h>
#include <string.h>

typedef struct {
    uint64_t version; /* odd while the rest is written */
    double time, pose[16], velocity[6];
} robot_state;

typedef struct {
    double time, number, stamp, command[6], executed[6], velocity[6], pose[16];
} robot_record;

/* Read the whole state of one moment. */
static inline void robot_read(const robot_state* shared, robot_state* found) {
    for (;;) {
        const uint64_t before = __atomic_load_n(&shared->version, __ATOMIC_SEQ_CST);
        memcpy(found, (const void*)shared, sizeof *found);
        if (!(before & 1) && before == __atomic_load_n(&shared->version, __ATOMIC_SEQ_CST)) return;
    }
}

#endif
