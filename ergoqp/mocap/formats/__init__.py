"""The formats of motion-capture files, one reader each, and the marks that tell some of them."""

from __future__ import annotations

from typing import Final

BAG_MARKS: Final = {b"#ROSBAG V": ".bag", b"SQLite format 3\0": ".db3", b"\x89MCAP0\r\n": ".mcap"}
"""First bytes of a ROS bag's file -> the ending that rosbags expects."""

C3D_BLOCK: Final = 512
C3D_KEY: Final = 0x50
"""Second byte of a C3D file."""
C3D_PROCESSORS: Final = {84: "Intel", 85: "DEC", 86: "MIPS"}
"""Fourth byte of a C3D file's parameters -> the computer whose numbers it has."""

NEXUS_SECTIONS: Final = (
    "Trajectories",
    "Devices",
    "Model Outputs",
    "Joints",
    "Segments",
    "Events",
)
"""Names of sections of Nexus' export; a file begins with one."""


def is_c3d(first: bytes) -> bool:
    """Return whether a file is a C3D file, from its first bytes.

    Args:
        first: its first bytes, 255 blocks or all.
    """
    if len(first) < C3D_BLOCK or first[1] != C3D_KEY or first[0] < 2:
        return False
    at = C3D_BLOCK * (first[0] - 1) + 3
    return at < len(first) and first[at] in C3D_PROCESSORS


def section_of(row: str) -> str | None:
    """Return the section of Nexus' export that a row begins; None if it begins none."""
    word = row.strip(' \t\r\n,;"')
    return word if word in NEXUS_SECTIONS else None
