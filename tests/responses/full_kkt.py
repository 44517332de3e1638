"""S(q) a second time: MuJoCo's Jacobians, all 36 rates at once, soles as equations; nothing
eliminated, no CasADi."""

from __future__ import annotations

import mujoco
import numpy as np

from ergoqp.joints import INDEX
from ergoqp.responses import IkResponse

TOOL_AXIS = {"along": np.array([1.0, 0, 0]), "thumb": np.array([0, 0, 1.0])}


def placed(response: IkResponse, posture: np.ndarray) -> mujoco.MjData:
    """The body in the world, its pelvis where the response says."""
    pelvis = np.array(response.contact()(posture)[1])
    data = mujoco.MjData(response.body.model)
    data.qpos[:3] = pelvis[:3, 3]
    data.qpos[3] = np.arctan2(pelvis[1, 0], pelvis[0, 0])
    data.qpos[4:] = posture
    mujoco.mj_kinematics(response.body.model, data)
    mujoco.mj_comPos(response.body.model, data)
    return data


def frame(data: mujoco.MjData, name: str) -> np.ndarray:
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = data.site(name).xmat.reshape(3, 3), data.site(name).xpos
    return pose


def jacobian(data: mujoco.MjData, name: str) -> np.ndarray:
    rows = np.zeros((6, 36))
    mujoco.mj_jacSite(data.model, data, rows[:3], rows[3:], data.model.site(name).id)
    return rows


def contact_of(response: IkResponse, data: mujoco.MjData) -> np.ndarray:
    """The contact frame by its definition, from MuJoCo's grips."""
    turn = np.eye(3) if response.tool == "along" else np.array([[0, 0, 1], [0, 1, 0], [-1, 0, 0]]).T
    grips = [frame(data, f"{hand}_grip") for hand in response.hands]
    pose = np.eye(4)
    pose[:3, 3] = np.mean([grip[:3, 3] for grip in grips], axis=0)
    if len(grips) == 1:
        pose[:3, :3] = grips[0][:3, :3] @ turn
        return pose
    y = grips[1][:3, 3] - grips[0][:3, 3]
    y /= np.linalg.norm(y)
    x = sum((grip[:3, :3] @ turn)[:, 0] for grip in grips)
    x = x - y * (x @ y)
    x /= np.linalg.norm(x)
    pose[:3, :3] = np.column_stack([x, y, np.cross(x, y)])
    return pose


def rows_of(response: IkResponse, data: mujoco.MjData) -> tuple[np.ndarray, np.ndarray]:
    """Hand rows of all 36 rates, and what a twist of the contact asks of them; the free turn is
    taken out of both."""
    contact = contact_of(response, data)
    axis, moves, wants = contact[:3, 0], [], []
    for hand in response.hands:
        offset = frame(data, f"{hand}_grip")[:3, 3] - contact[:3, 3]
        carried = np.eye(6)
        carried[:3, 3:] = -np.array(
            [[0, -offset[2], offset[1]], [offset[2], 0, -offset[0]], [-offset[1], offset[0], 0]]
        )
        kept = np.eye(6)
        if response.free_about_tool:
            kept[3:, 3:] -= np.outer(axis, axis)
        moves.append(kept @ jacobian(data, f"{hand}_grip"))
        wants.append(kept @ carried)
    return np.vstack(moves), np.vstack(wants)


def missing(data: mujoco.MjData, work: np.ndarray) -> np.ndarray:
    """What is missing (3,) for seeing the work with ease, by angles and from MuJoCo's head."""
    head = frame(data, "eyes")
    toward = head[:3, :3].T @ (work - head[:3, 3])
    distance = np.linalg.norm(toward)
    ease = np.array([np.cos(np.radians(15)), 0, -np.sin(np.radians(15))])
    up = np.array([np.sin(np.radians(15)), 0, np.cos(np.radians(15))])
    toward = toward / distance
    aside = np.array([toward[1], toward @ up]) * 2.1 / (1.1 + toward @ ease)
    turn = np.hypot(*aside)
    beyond = turn - np.radians(15) * turn / np.hypot(turn, np.radians(15))
    near = 0.3 - distance
    nearness = near / 0.3 / 2 + np.sqrt(near**2 + 0.03**2) / 0.3 / 2
    return np.append(aside * (beyond / turn if turn > 1e-9 else 0.0), nearness)


def eyes_of(response: IkResponse, data: mujoco.MjData) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """What is missing (3,), its change with all 36 rates (3, 36) and with a twist (3, 6): central
    differences."""
    work, step = contact_of(response, data)[:3, 3], 1e-5
    other = mujoco.MjData(data.model)

    def at(qpos: np.ndarray, place: np.ndarray) -> np.ndarray:
        other.qpos[:] = qpos
        mujoco.mj_kinematics(data.model, other)
        return missing(other, place)

    by_rates, by_twist = np.zeros((3, 36)), np.zeros((3, 6))
    for i, change in enumerate(step * np.eye(36)):
        by_rates[:, i] = (at(data.qpos + change, work) - at(data.qpos - change, work)) / (2 * step)
    for i, change in enumerate(step * np.eye(3)):
        by_twist[:, i] = (at(data.qpos, work + change) - at(data.qpos, work - change)) / (2 * step)
    return at(data.qpos, work), by_rates, by_twist


def swings_of(response: IkResponse) -> list[int]:
    """Numbers of the joints that gravity turns."""
    return [INDEX[joint] for joint in response.joints if joint not in response.chain]


def mobile(response: IkResponse, locked: np.ndarray) -> np.ndarray:
    """The rates, of all 36, that may differ from zero."""
    base = [0, 1, 2, 3] if response.stance == "standing" else []
    return np.array(
        base + [4 + INDEX[joint] for joint in response.chain if not locked[INDEX[joint]]]
    )


def sensitivity(
    response: IkResponse, posture: np.ndarray, locked: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Return S (32, 6) and the unmet contact motion per twist (6 k, 6), world axes.

    min 1/2 v'Wv + 1/2 balance |v_xy|^2 + 1/(2 damping^2) |hands v - wanted xi|^2 + 1/2 attention
    |eyes v + work xi|^2  s.t.  both soles stay (standing). An arm that hangs is left out: zero.
    """
    data = placed(response, posture)
    moves, wants = rows_of(response, data)
    columns = mobile(response, locked)
    weights = np.concatenate([[response.balance, response.balance, 0, 0], response.weight_vector])[
        columns
    ]
    hands = moves[:, columns]
    H = np.diag(weights) + hands.T @ hands / response.damping**2
    g = -hands.T @ wants / response.damping**2
    if response.looks:
        _, by_rates, by_twist = eyes_of(response, data)
        eyes = by_rates[:, columns]
        H += response.attention * eyes.T @ eyes
        g += response.attention * eyes.T @ by_twist
    soles = np.zeros((0, len(columns)))
    if response.stance == "standing":
        soles = np.vstack([jacobian(data, "right_sole"), jacobian(data, "left_sole")])[:, columns]
    kkt = np.block([[H, soles.T], [soles, np.zeros((len(soles), len(soles)))]])
    # Locked legs may leave fewer free rates than sole rows: the least-squares solution is the
    # constrained optimum.
    answer = np.linalg.lstsq(kkt, np.vstack([-g, np.zeros((len(soles), 6))]), rcond=1e-13)[0]
    rates = np.zeros((36, 6))
    rates[columns] = answer[: len(columns)]
    return rates[4:], wants - moves @ rates
