"""Markers of the Plug-in Gait set on our own person, and files of them: C3D and tables."""

from __future__ import annotations

from pathlib import Path
from typing import Final

import numpy as np

from ergoqp.human import Body
from ergoqp.human.body import Marker
from ergoqp.joints import SIDES
from ergoqp.mocap.markers.fit import places_of_markers
from ergoqp.mocap.naming import centres_of

BLOCK: Final = 512
_HALF: Final = {"knee": 0.057, "ankle": 0.043, "elbow": 0.044}


def plug_in_gait(body: Body) -> dict[str, Marker]:
    """Return the set's 38 markers as they would sit on a body."""
    size, at = body.lengths, lambda frame: body.model.site(frame).pos
    still = centres_of(body, np.zeros((1, 4)), np.zeros((1, 32)))
    width = (size["hip_width"] / 2 - 0.0073) / 0.33
    ahead, up = 0.24 * 0.15 + 0.0099, 0.30 * width + 0.0109
    neck = at("neck")
    places: dict[str, tuple[str, tuple[float, float, float]]] = {
        "C7": ("trunk", (neck[0] - 0.07, 0.0, neck[2] + 0.02)),
        "CLAV": ("trunk", (neck[0] + 0.07, 0.0, neck[2] - 0.02)),
        "T10": ("trunk", (neck[0] - 0.11, 0.0, neck[2] - 0.22)),
        "STRN": ("trunk", (neck[0] + 0.11, 0.0, neck[2] - 0.20)),
        "RBAK": ("trunk", (neck[0] - 0.10, -0.09, neck[2] - 0.12)),
    }
    for side in SIDES:
        letter, out = side[0].upper(), -1.0 if side == "right" else 1.0
        shoulder = still[f"{side}_shoulder"][0] - still["neck"][0] + neck
        places |= {
            f"{letter}FHD": ("head", (0.09, 0.07 * out, 0.10)),
            f"{letter}BHD": ("head", (-0.07, 0.07 * out, 0.10)),
            f"{letter}SHO": ("trunk", (shoulder[0], shoulder[1], shoulder[2] + 0.047)),
            f"{letter}UPA": (f"{side}_shoulder", (0.02, 0.05 * out, -0.5 * size["upper_arm"])),
            f"{letter}ELB": (f"{side}_shoulder", (0.0, _HALF["elbow"] * out, -size["upper_arm"])),
            f"{letter}FRM": (f"{side}_wrist", (0.0, 0.03 * out, 0.6 * size["forearm"])),
            f"{letter}WRA": (f"{side}_wrist", (0.03, 0.0, 0.0)),
            f"{letter}WRB": (f"{side}_wrist", (-0.03, 0.0, 0.0)),
            f"{letter}FIN": (f"{side}_wrist", (0.0, 0.02 * out, -0.08)),
            f"{letter}ASI": ("pelvis", (ahead, width / 2 * out, up)),
            f"{letter}PSI": ("pelvis", (ahead - 0.15, 0.05 * out, up)),
            f"{letter}THI": (f"{side}_hip", (0.0, 0.08 * out, -0.6 * size["thigh"])),
            f"{letter}KNE": (f"{side}_hip", (0.0, _HALF["knee"] * out, -size["thigh"])),
            f"{letter}TIB": (f"{side}_knee", (0.0, 0.06 * out, -0.5 * size["shank"])),
            f"{letter}ANK": (f"{side}_knee", (0.0, _HALF["ankle"] * out, -size["shank"])),
            f"{letter}HEE": (f"{side}_ankle", (-0.05, 0.0, -0.05)),
            f"{letter}TOE": (f"{side}_ankle", tuple(at(f"{side}_toe"))),
        }
    return {name: Marker(frame, place, 0.0) for name, (frame, place) in places.items()}


def markers_of(
    body: Body, pelvis: np.ndarray, postures: np.ndarray
) -> tuple[tuple[str, ...], np.ndarray]:
    """Return the markers' names, and where they are (n, m, 3) [m]."""
    paths = places_of_markers(body, pelvis, postures, plug_in_gait(body))
    return tuple(paths), np.stack(list(paths.values()), axis=1)


def write_c3d(
    path: Path, names: tuple[str, ...], positions: np.ndarray, rate: float, times: int = 1
) -> int:
    """Write a C3D file of floats in mm, Intel; return its number of frames.

    Args:
        path: where to.
        names: of the points.
        positions: (n, m, 3) [m]; NaN where not seen.
        rate: frames per second [Hz].
        times: how often the movement is written, one after the other.
    """
    count = len(positions) * times
    letters = max(map(len, names))
    labels = b"".join(name.encode().ljust(letters) for name in names)
    long_end = np.array([count % 65536, count // 65536], "<u2").tobytes()
    groups = _group(1, "POINT") + _group(2, "TRIAL")
    groups += _parameter(1, "LABELS", -1, (letters, len(names)), labels)
    groups += _parameter(1, "UNITS", -1, (2,), b"mm")
    groups += _parameter(1, "USED", 2, (), np.array(len(names), "<i2").tobytes())
    groups += _parameter(1, "RATE", 4, (), np.array(rate, "<f4").tobytes())
    groups += _parameter(2, "ACTUAL_START_FIELD", 2, (2,), np.array([1, 0], "<u2").tobytes())
    groups += _parameter(2, "ACTUAL_END_FIELD", 2, (2,), long_end)
    section = b"\1\x50" + bytes([-(-(len(groups) + 6) // BLOCK), 84]) + groups
    section = section.ljust(BLOCK * section[2], b"\0")
    start = 2 + len(section) // BLOCK
    head = bytearray(BLOCK)
    head[:2] = b"\2\x50"
    head[2:12] = np.array([len(names), 0, 1, min(count, 65535), 10], "<u2").tobytes()
    head[12:16] = np.array(-0.1, "<f4").tobytes()
    head[16:20] = np.array([start, 0], "<u2").tobytes()
    head[20:24] = np.array(rate, "<f4").tobytes()
    rows = np.zeros((*positions.shape[:2], 4), "<f4")
    rows[:, :, :3] = 1000 * np.nan_to_num(positions)
    rows[:, :, 3] = np.where(np.isnan(positions).any(axis=2), -1, 0)
    with path.open("wb") as file:
        file.write(bytes(head) + section)
        for _ in range(times):
            file.write(rows.tobytes())
    return count


def write_table(
    path: Path, names: tuple[str, ...], positions: np.ndarray, rate: float, times: int = 1
) -> int:
    """Write a table of positions [m] with times [s]; return its number of frames."""
    head = ",".join(["time", *(f"{name}.{axis}" for name in names for axis in "xyz")])
    flat = positions.reshape(len(positions), -1)
    rows = [",".join(f"{value:.4f}" for value in row) for row in flat]
    with path.open("w", encoding="utf-8") as file:
        file.write(f"{head}\n")
        for i in range(times):
            first = i * len(rows)
            file.writelines(f"{(first + k) / rate:.6f},{row}\n" for k, row in enumerate(rows))
    return times * len(rows)


def _group(number: int, name: str) -> bytes:
    return bytes([len(name), 256 - number]) + name.encode() + np.array(3, "<i2").tobytes() + b"\0"


def _parameter(group: int, name: str, kind: int, shape: tuple[int, ...], data: bytes) -> bytes:
    body = bytes([kind % 256, len(shape), *shape]) + data + b"\0"
    step = np.array(len(body) + 2, "<i2").tobytes()
    return bytes([len(name), group]) + name.encode() + step + body
