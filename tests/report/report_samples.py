"""A synthetic run and a synthetic recording: made here, so that the report is tested apart from
what fills it."""

import numpy as np

from ergoqp.human import Body
from ergoqp.joints import INDEX
from ergoqp.mocap import Recording
from ergoqp.report.body.person import place
from ergoqp.sheets import reba
from ergoqp.simulation.run import Run

AWKWARD = {
    "trunk_flexion": 52,
    "trunk_twist": 18,
    "neck_flexion": -12,
    "neck_twist": 15,
    "right_shoulder_flexion": 105,
    "right_shoulder_abduction": 35,
    "right_elbow_flexion": 35,
    "right_wrist_flexion": 25,
    "left_shoulder_flexion": 60,
    "left_elbow_flexion": 80,
    "right_hip_flexion": 25,
    "left_hip_flexion": 25,
    "right_knee_flexion": 45,
    "left_knee_flexion": 45,
    "right_ankle_flexion": 20,
    "left_ankle_flexion": 20,
}
EASY = {
    "trunk_flexion": 4,
    "neck_flexion": 8,
    "right_shoulder_flexion": 18,
    "right_elbow_flexion": 75,
    "right_wrist_flexion": 6,
    "left_shoulder_flexion": 10,
    "left_elbow_flexion": 70,
    "right_hip_flexion": 2,
    "left_hip_flexion": 2,
    "right_knee_flexion": 4,
    "left_knee_flexion": 4,
    "right_ankle_flexion": 2,
    "left_ankle_flexion": 2,
}


def posture(angles):
    q = np.zeros(32)
    for name, degrees in angles.items():
        q[INDEX[name]] = np.radians(degrees)
    return q


def make_movement(duration, rate, seed=0):
    """Time, postures, base poses and object poses of somebody who is led from an awkward to an easy
    posture."""
    random = np.random.default_rng(seed)
    body = Body.of_stature(1.75)
    n = round(duration * rate) + 1
    time = np.arange(n) / rate
    share = 1 - np.exp(-time / (0.2 * duration))
    postures = posture(AWKWARD) + share[:, None] * (posture(EASY) - posture(AWKWARD))
    postures += np.radians(0.4) * np.cumsum(random.normal(size=(n, 32)), axis=0) / np.sqrt(rate)
    bases = np.tile(np.eye(4), (n, 1, 1))
    ankles = place(body, postures, bases).of("right_ankle_inversion")[0]
    bases[:, 2, 3] = 0.07 - ankles[:, 2]
    hands = place(body, postures, bases)
    position, _ = hands.of("right_wrist_deviation")
    objects = np.tile(np.eye(4), (n, 1, 1))
    objects[:, :3, 3] = position + np.array([0.08, 0, 0])
    return body, time, postures, bases, objects


def make_run(duration=6.0, rate=50, **changes):
    body, time, postures, bases, objects = make_movement(duration, rate)
    n, random = len(time), np.random.default_rng(1)
    scores = reba.assess(postures)
    velocity = np.gradient(objects[:, :3, 3], time, axis=0)
    twists = np.concatenate(
        [velocity, 0.05 * np.sin(time[:, None] * np.array([1.0, 2.0, 3.0]))], axis=1
    )
    settled = time > 0.8 * duration
    statuses = np.where(
        settled, "settled", np.where(random.random(n) < 0.05, "relaxed", "optimal")
    ).tolist()
    statuses[n // 3] = "braking"
    values = dict(
        problem="screwing",
        title="Screwing at a desk that rises",
        body=body,
        joints=("trunk_flexion",),
        dt=1 / rate,
        seed=0,
        time=time,
        postures=postures,
        base_poses=bases,
        poses=objects,
        twists=twists,
        reba=scores.final,
        cost=scores.final + 0.3 * np.sin(time),
        statuses=statuses,
        reasons=[""] * n,
        active=[
            ("speed",) * int(t < 0.3 * duration) + ("workspace z",) * int(0.2 < t / duration < 0.5)
            for t in time.tolist()
        ],
        step_time=1e-5 * random.lognormal(1.2, 0.4, n),
        assessment=reba.assess(postures[[0, -1]]),
        violations={"speed": 0, "workspace": 0, "boundary": 2},
        max_violation={"speed": 0.0, "workspace": 0.0, "boundary": 0.012},
        units={"speed": "m/s", "workspace": "m", "boundary": "1"},
        person_outside={"neck_flexion": 3},
        let_go=None,
        options=[
            ("cost", "smooth REBA, 0.8 at 1.5 deg and 0.2 at 12 deg"),
            ("look-ahead", "0.5 s"),
            ("solver", "daqp"),
        ],
        assumptions=["The load is taken as 0 kg.", "Both feet stay where they stand at first."],
    )
    values.update(changes)
    return Run(**values)


def make_recording(duration=6.0, rate=50):
    body, time, postures, bases, _ = make_movement(duration, rate, seed=3)
    lost = np.isin(np.arange(len(time)), range(20, 25))
    return Recording(
        time=time,
        postures=postures,
        base_poses=bases,
        observed=np.ones_like(postures, dtype=bool),
        fit_error=0.01 + 0.004 * np.sin(time),
        object_poses=None,
        assumptions=("The unit of length is taken as cm.", "The vertical axis is taken as y."),
        person=body,
        errors={"neck": 0.01 + 0 * time},
        not_scored={"left elbow not seen": lost},
    )
