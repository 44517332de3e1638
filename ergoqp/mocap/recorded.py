"""The task of a problem as done by the person of a recording: their body, stance, seat and tool.

A recording does not show what is in the hand. So the tool points where the hand points, and
the workspace includes the place of the hand.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any, Final

import mujoco
import numpy as np
from scipy.optimize import least_squares

from ergoqp.costs.smooth_reba import SmoothReba
from ergoqp.errors import InputError
from ergoqp.human import Kinematics
from ergoqp.joints import INDEX, LOWER, SIDES, UPPER
from ergoqp.limits.workspace import AxisCone, WorkspaceBox
from ergoqp.mocap import Recording
from ergoqp.mocap.fitting.validity import LEG
from ergoqp.problem.problem import Problem
from ergoqp.responses.gmr import mean_pose
from ergoqp.responses.ik import IkResponse
from ergoqp.sheets.options import TaskOptions

_BEHIND: Final = 0.05
"""A person whose centre of mass is further than this behind both heels must be sitting [m]."""
_BENT: Final = np.radians(45)
_UNLOCKED: Final = np.radians(5)
"""Least knee flexion of people who stand at work [rad]."""
_UNEVEN: Final = 0.02
"""Largest height of one sole above the floor of the other [m]."""
_ASKEW: Final = np.radians(10)
_HELD: Final = 0.05
"""An object whose place in the hand is further from that of most frames is not held [m]."""
_MOSTLY: Final = 0.1
"""Least share of frames in which it is held."""
_ROOM: Final = 0.02
"""Margin around the place of the hand, because the person may hold the object differently [m]."""


def as_recorded(
    problem: Problem, recording: Recording, frame: int
) -> tuple[Problem, np.ndarray, list[str]]:
    """Return the problem with the person of a frame, their posture (32,) [rad], and assumptions.

    Args:
        problem: the task; its response must be an `IkResponse`.
        recording: recording of the person.
        frame: number of the frame.

    Raises:
        InputError: if the person neither sits nor stands, or if their stance is not that of
            the problem and its cost is learned.
    """
    response, above = problem.response, seat_above_feet(recording, frame)
    assert isinstance(response, IkResponse)
    stance = "standing" if above is None else "seated"
    terms: dict[str, Any] = {}
    cost = problem.cost
    if stance != response.stance and isinstance(cost, SmoothReba):
        task: TaskOptions = {**problem.task, "seated": stance == "seated"}
        terms["task"] = task
        terms["cost"] = SmoothReba(cost.taus_deg, cost.weights, cost.method, **task)
    elif stance != response.stance:
        raise InputError(
            f"--from: the person is {stance} in the recording and {response.stance} in problem"
            f" {problem.name}, whose learned cost knows only that; choose another frame (--at) or"
            " the cost smooth_reba"
        )
    posture = planted(recording, frame) if above is None else recording.postures[frame]
    notes = [
        "The body is that of the recording"
        + (", and both soles are set on the floor." if above is None else ", and so is its seat.")
    ]
    if stance != response.stance:
        notes.append(f"The person is {stance}, as in the recording.")
    person = replace(response, body=recording.person, stance=stance, seat_height=above)
    pose = np.array(person.contact()(posture)[0])
    limits = []
    for limit in problem.limits:
        if isinstance(limit, WorkspaceBox):
            lower = np.minimum(limit.lower, pose[:3, 3] - _ROOM)
            upper = np.maximum(limit.upper, pose[:3, 3] + _ROOM)
            wider = replace(limit, lower=tuple(lower.tolist()), upper=tuple(upper.tolist()))
            if wider != limit:
                notes.append("The workspace is extended to the place of the hand in the recording.")
            limits.append(wider)
        elif isinstance(limit, AxisCone) and not _inside(limit, pose[:3, 0]):
            notes.append("The cone of the tool axis is centred on the direction in the recording.")
            limits.append(replace(limit, direction=tuple(pose[:3, 0].tolist())))
        else:
            limits.append(limit)
    return problem.replace(response=person, limits=tuple(limits), **terms), posture, notes


def held_poses(
    recording: Recording, response: IkResponse, by_hand: bool = False
) -> tuple[np.ndarray, np.ndarray]:
    """Return postures (n, 32) and where the object is in each (n, 4, 4), for a response to learn.

    The poses are in the world of the response's `contact`, and of the contact frame: the object's
    own frame is turned and shifted to it. Frames that show no whole posture, or no object in the
    hand, are left out.

    Args:
        recording: recording of a person at work.
        response: model person, with the body and the hands of the recording.
        by_hand: the hand of the recording stands for the object.

    Raises:
        InputError: if the recording has no held object, or no frame shows it in the hand.
    """
    known, held = recording.whole, recording.object_poses
    if not by_hand:
        if held is None:
            raise InputError(
                "recording: has no held object; name one with --thing, or let the hand stand for"
                " the object with --by-hand"
            )
        known = known & np.isfinite(held).all(axis=(1, 2))
    if not known.any():
        raise InputError("recording: no frame shows a posture and the object")
    postures = recording.postures[known]
    found = response.contact().map(len(postures))(postures.T)
    contact, pelvis = (np.array(part).reshape(4, -1, 4).transpose(1, 0, 2) for part in found)
    if by_hand or held is None:
        return postures, contact
    seen = pelvis @ np.linalg.inv(recording.base_poses[known]) @ held[known]
    grips = np.linalg.inv(seen) @ contact
    # The place in the hand that most frames are near to; a few hundred are tried.
    places = grips[:, :3, 3]
    tried = places[:: max(1, len(places) // 300)]
    near = np.linalg.norm(places[:, np.newaxis] - tried, axis=2) < _HELD
    holds = near[:, np.argmax(near.sum(axis=0))]
    if holds.mean() < _MOSTLY:
        raise InputError(
            f"recording: the object keeps its place in the hand in {holds.sum()} of {len(holds)}"
            f" frames, allowed {_MOSTLY:.0%} or more: choose a part (--window), or the hand or the"
            " object that is meant"
        )
    return postures[holds], seen[holds] @ mean_pose(grips[holds], response.free_about_tool)


def planted(recording: Recording, frame: int) -> np.ndarray:
    """Return the posture of a frame (32,) [rad] with both soles flat on one floor.

    In recordings the soles are tilted and feet are lifted. A person who does the task of a
    problem stands on both feet. The legs change as little as possible, and nothing above the
    hips changes.

    Args:
        recording: recording of the person.
        frame: number of the frame.

    Raises:
        InputError: if the person cannot stand so, for example because they kneel.
    """
    posture, kinematics = recording.postures[frame].copy(), Kinematics(recording.person)
    soles = {side: kinematics.function(f"{side}_sole") for side in SIDES}
    legs = {side: [INDEX[f"{side}_{joint}"] for joint in LEG] for side in SIDES}
    for side in SIDES:
        knee = INDEX[f"{side}_knee_flexion"]
        posture[knee] = max(posture[knee], _UNLOCKED)
    stood = {side: np.array(soles[side](posture)[0]).ravel() for side in SIDES}
    floor = min(place[2] for place in stood.values())
    for side in SIDES:
        leg, given = legs[side], posture[legs[side]]
        lower, upper = LOWER[leg].copy(), UPPER[leg]
        lower[LEG.index("knee_flexion")] = _UNLOCKED

        def off(angles: np.ndarray, side: str = side) -> np.ndarray:
            trial = posture.copy()
            trial[legs[side]] = angles
            place, axes, _ = (np.array(each) for each in soles[side](trial))
            aside = place.ravel() - stood[side]
            aside[2] = 10 * (place[2, 0] - floor)
            given = recording.postures[frame, legs[side]]
            return np.concatenate([aside, 3 * axes[2, :2], 0.05 * (angles - given)])

        start = np.clip(given, lower + 1e-3, upper - 1e-3)
        posture[leg] = least_squares(off, start, bounds=(lower, upper)).x
        place, axes, _ = (np.array(each) for each in soles[side](posture))
        if abs(place[2, 0] - floor) > _UNEVEN or axes[2, 2] < np.cos(_ASKEW):
            raise InputError(
                f"--from: in frame {frame} the person neither sits nor stands on both feet; choose"
                " another frame (--at)"
            )
    return posture


def seat_above_feet(recording: Recording, frame: int) -> float | None:
    """Return the height of the hips of a sitting person above the floor [m]; None if they stand.

    A person with bent knees and the centre of mass behind both heels would fall, so they sit.

    Args:
        recording: recording of the person.
        frame: number of the frame.
    """
    posture, model = recording.postures[frame], recording.person.model
    legs = [INDEX[f"{side}_{joint}"] for side in SIDES for joint in ("hip_flexion", "knee_flexion")]
    bent = min(posture[INDEX[f"{side}_knee_flexion"]] for side in SIDES) > _BENT
    if not (bent and recording.observed[frame, legs].all()):
        return None
    data = mujoco.MjData(model)
    data.qpos[-len(posture) :] = posture
    mujoco.mj_forward(model, data)
    heels, soles = (
        np.array([data.site(f"{side}_{name}").xpos for side in SIDES]) for name in ("heel", "sole")
    )
    if data.subtree_com[0][0] > heels[:, 0].min() - _BEHIND:
        return None
    height = data.site("pelvis").xpos[2] - soles[:, 2].min()
    return float(np.clip(height, 0.05, 1.2))


def _inside(cone: AxisCone, axis: np.ndarray) -> bool:
    return bool(np.asarray(cone.direction) @ axis >= np.cos(np.radians(cone.half_angle_deg)))
