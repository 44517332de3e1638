"""What `benchmarks.faults` finds in the records of a trial, by formulas of its own."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

import numpy as np

from benchmarks.faults_world import World

ROBOT: Final = np.dtype(
    [
        *((name, "f8") for name in ("time", "late", "number", "stamp")),
        *((name, "f8", 6) for name in ("command", "executed", "velocity")),
        ("pose", "f8", (4, 4)),
    ]
)
TWISTS: Final = np.dtype(
    [
        *((name, "f8") for name in ("time", "number", "stamp", "ramps")),
        *((name, "f8", 6) for name in ("before", "twist")),
    ]
)
_LOOP: Final = "time number fresh status reason waits begins rests late lost refused known moves"
LOOP: Final = np.dtype(
    [(name, "f8") for name in _LOOP.split()] + [("twist", "f8", 6), ("posture", "f8", 32)]
)
"""Records of `service_robot.h`."""

DT: Final = 0.01
ROUNDING: Final = 1e-6
"""Largest excess over a limit that is rounding (a share)."""
OF_STAMPS: Final = 2e-3
"""The same behind a relay, whose stamps are not whole periods apart."""
AT: Final = 1e-6
"""Largest distance beyond a limit that is rounding [m, rad]."""
_OPTIMAL, _SETTLED = 0, 1
STANDING: Final = 0.002
"""Speed below which the robot reports that it stands [m/s, rad/s]."""
NEVER: Final = 99.0
"""Stands for a time that did not come in a trial [s]."""


@dataclass
class Found:
    """What one trial left behind.

    Attributes:
        speed, acceleration, jerk: largest shares of their limits.
        outside_mm: largest distance beyond the workspace, or into the ball; negative inside.
        outside_deg: largest angle beyond the cone.
        rest_late_s: how much later than the stop's time the commanded twist was zero.
        back_s: time from the end of the fault until the object was moved again, without the time
            of the stop; -1 if it is not asked for.
        waited_s: how long the processes that had to come back stood ready to run, and the machine
            gave them no processor; -1 if it is not asked for.
        robot_late_s: how late the robot's clock was at most, by the machine's fault.
        way_m: how far the object came.
        record_lost, record_wrong: steps missing in its record without being counted there, and
            steps that a replay computes otherwise.
        wrong: what else is not as it should be, one sentence each.
        unsafe: what was beyond the declaration, by name.
    """

    speed: float = 0.0
    acceleration: float = 0.0
    jerk: float = 0.0
    outside_mm: float = -1e3
    outside_deg: float = -1e3
    rest_late_s: float = -1.0
    back_s: float = -1.0
    waited_s: float = -1.0
    robot_late_s: float = 0.0
    way_m: float = 0.0
    record_lost: int = 0
    record_wrong: int = 0
    wrong: list[str] = field(default_factory=list)
    unsafe: list[str] = field(default_factory=list)


def read_loop(path: Path) -> np.ndarray:
    """Return the periods that a loop recorded."""
    if not path.exists():
        return np.empty(0, LOOP)
    rows = np.fromfile(path, LOOP)
    return rows[rows["number"] > 0]


def judge(world: World, folder: Path, relayed: bool, exempt: tuple[str, ...] = ()) -> Found:
    """Return what robot and limits say of a trial; what is exempt is measured, and not unsafe."""
    found = Found()
    robot, twists = np.fromfile(folder / "robot", ROBOT), np.fromfile(folder / "twists", TWISTS)
    if not len(robot) or not len(twists):
        found.wrong.append("the robot was sent nothing")
        return found
    place, axis = robot["pose"][:, :3, 3], robot["pose"][:, :3, 0]
    beyond = np.maximum(world.lower - place, place - world.upper).max()
    inside = (world.radius - np.linalg.norm(place - world.centre, axis=1)).max()
    found.outside_mm = 1e3 * float(max(beyond, inside))
    # The angle by its tangent: the arc cosine has no digits near zero.
    apart = np.arctan2(np.linalg.norm(np.cross(axis, world.axis), axis=1), axis @ world.axis)
    found.outside_deg = float(np.degrees(apart.max() - world.half))
    found.robot_late_s = float(robot["late"].max())
    found.way_m = float(np.linalg.norm(np.diff(place, axis=0), axis=1).sum())
    found.speed = float((np.abs(robot["command"]) / world.speed).max())
    slopes, bends = _of_relay(twists) if relayed else _of_loop(twists)
    jerk = 2 * world.acceleration / world.average
    found.acceleration = float((np.abs(slopes) / world.acceleration).max(initial=0.0))
    found.jerk = float((np.abs(bends) / jerk).max(initial=0.0))
    for name, value, most in (
        ("speed", found.speed - 1, ROUNDING),
        ("acceleration", found.acceleration - 1, ROUNDING),
        ("jerk", found.jerk - 1, OF_STAMPS if relayed else ROUNDING),
        ("place", found.outside_mm, 1e3 * AT),
        ("cone", found.outside_deg, np.degrees(AT)),
    ):
        if value > most and name not in exempt:
            found.unsafe.append(name)
    return found


def _of_loop(twists: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return slopes and their changes per period, of a robot that holds each twist."""
    slopes = (twists["twist"] - twists["before"]) / DT
    # A ramp of the robot itself between two twists is its own.
    usual = (twists["ramps"][1:] == 0) & (twists["ramps"][:-1] == 0)
    return slopes, ((slopes[1:] - slopes[:-1]) / DT)[usual]


def _of_relay(twists: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return slopes and their changes over one period of the loop, by the relay's own clock."""
    at, sent = twists["stamp"], twists["twist"]
    # From every twist to the one that is nearest to one period later.
    later = np.minimum(np.searchsorted(at, at + DT - 0.0005), len(at) - 1)
    whole = (later > np.arange(len(at))) & (later < len(at) - 1)
    lasts = np.where(whole, at[later] - at, DT)
    slopes = (sent[later] - sent) / lasts[:, None]
    second = np.flatnonzero(whole & whole[later])
    # Means of slopes over windows that are a little shorter than a period may differ as much as
    # those over a whole one.
    spans = np.maximum(np.maximum(lasts[second], lasts[later[second]]), DT)
    bends = (slopes[later[second]] - slopes[second]) / spans[:, None]
    return slopes[whole], bends


def zero_since(folder: Path, since: float) -> float:
    """Return when the robot was sent zero for the first time after a moment, or infinity."""
    robot = np.fromfile(folder / "robot", ROBOT)
    still = (robot["time"] >= since) & ~robot["command"].any(axis=1)
    return float(robot["time"][still][0]) if still.any() else np.inf


def settles(loop: np.ndarray, folder: Path, fault: float) -> float:
    """Return how long the robot itself took to stand after it was sent zero [s].

    It is 0 if the loop did not have to wait for that.
    """
    begins = loop["time"][(loop["begins"] > 0) & (loop["time"] > fault)]
    robot = np.fromfile(folder / "robot", ROBOT)
    since = zero_since(folder, fault)
    if not len(begins) or begins[0] < since:
        return 0.0
    stands = (robot["time"] >= since) & (np.abs(robot["velocity"]).max(axis=1) < STANDING)
    return float(robot["time"][stands][0] - since) if stands.any() else 0.0


def rest_late(loop: np.ndarray, folder: Path, fault: float, relayed: bool) -> float:
    """Return how much later than the stop's time the commanded twist was zero [s].

    It is asked of a fault after which the loop gave no fresh answer until the stop was over;
    otherwise -1 is returned.
    """
    fresh = loop[loop["fresh"] > 0]
    before = fresh[fresh["time"] <= fault + 2 * DT]
    if not len(before):
        return -1.0
    last = before[-1]
    # The stop counts from the twist, which a relay reaches one period later; one more period
    # passes until the loop notices that an answer does not come.
    due = last["time"] + last["rests"] + DT + (DT if relayed else 0.0)
    if (fresh["time"] > last["time"]).any() and fresh["time"][fresh["time"] > last["time"]][
        0
    ] < due:
        return -1.0
    return min(NEVER, zero_since(folder, last["time"]) - due)


def back(loop: np.ndarray, until: float) -> float:
    """Return the time until a fresh answer that moves the object, without that of the stop [s].

    Args:
        loop: the periods of all loops of the trial.
        until: end of the fault.
    """
    fresh = loop["fresh"] > 0
    moves = fresh & (loop["twist"].any(axis=1) | (loop["status"] == _SETTLED))
    # Answers that were under way when the fault came do not count.
    missed = np.flatnonzero(~fresh & (loop["time"] > until - 0.02))
    if not len(missed):
        return 0.0
    later = np.flatnonzero(moves & (loop["time"] > loop["time"][missed[0]]))
    if not len(later):
        return NEVER
    before = np.flatnonzero(fresh[: missed[0]])
    stop = loop["rests"][before[-1]] if len(before) else 0.0
    return float(loop["time"][later[0]] - max(until, loop["time"][missed[0]]) - stop)
