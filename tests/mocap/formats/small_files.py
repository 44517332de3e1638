"""Recordings of three frames in every text format, to be changed by the tests."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from ergoqp.arguments import Progress, unseen
from ergoqp.errors import RecordingError
from ergoqp.mocap.formats.text import TableOptions
from ergoqp.mocap.recording import JointMotion

Reader = Callable[[Path, Progress, TableOptions], JointMotion]

TABLE = """time,neck.x,neck.y,neck.z,hip.x,hip.y,hip.z
0.0,1,2,3,4,5,6
0.1,1.5,2.5,3.5,4.5,5.5,6.5
0.2,-1e-1,2,3,4,5,6.25
"""

TRC = """PathFileType\t4\t(X/Y/Z)\ttake.trc
DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits
10\t10\t3\t2\tmm
Frame#\tTime\tLASI\t\t\tR Knee\t\t\t
\t\tX1\tY1\tZ1\tX2\tY2\tZ2

1\t0.0\t1\t2\t3\t4\t5\t6
2\t0.1\t1.5\t2.5\t3.5\t4.5\t5.5\t6.5
3\t0.2\t-1e-1\t2\t3\t4\t5\t6.25
"""

STORAGE = """Coordinates
version=1
nRows=3
nColumns=3
inDegrees=yes

endheader
time\tknee_angle_r\tpelvis_tx
0.0\t90\t0.5
0.1\t45\t0.6
0.2\t0\t0.7
"""

MOTIVE = """Format Version,1.23,Take Name,hand, over,Export Frame Rate,10.000000,\
Total Exported Frames,3,Rotation Type,Quaternion,Length Units,Meters,Coordinate Space,Global

,Type,Bone,Bone,Bone,Bone,Bone,Bone,Bone,Rigid Body,Rigid Body,Rigid Body,Rigid Body,Rigid Body,\
Rigid Body,Rigid Body,Rigid Body,Marker,Marker,Marker
,Name,A:Hip,A:Hip,A:Hip,A:Hip,A:Hip,A:Hip,A:Hip,Box,Box,Box,Box,Box,Box,Box,Box,\
Unlabeled:7,Unlabeled:7,Unlabeled:7
,ID,1,1,1,1,1,1,1,2,2,2,2,2,2,2,2,3,3,3
,,Rotation,Rotation,Rotation,Rotation,Position,Position,Position,Rotation,Rotation,Rotation,\
Rotation,Position,Position,Position,Mean Marker Error,Position,Position,Position
Frame,Time (Seconds),X,Y,Z,W,X,Y,Z,X,Y,Z,W,X,Y,Z,,X,Y,Z
0,0.000000,0,0,0,1,1,2,3,1,0,0,0,7,8,9,0.001,,,
1,0.100000,0,0,0.6,0.8,1.5,2.5,3.5,0,1,0,0,7.5,8,9,0.001,5,5,5
2,0.200000,0,0,0,-1,1,2,3,,,,,,,,,5,5,5
"""

FRAME = """      <frame time="{i}" index="{i}" type="{kind}">
        <orientation>{turns}</orientation>
        <position>{places}</position>
        <jointAngle>{angles}</jointAngle>
      </frame>
"""


def mvnx_frame(i: int, kind: str = "normal") -> str:
    return FRAME.format(
        i=i,
        kind=kind,
        turns="1 0 0 0 0.8 0 0 0.6",
        places=f"{i} 0 1 {i} 0.5 1.5",
        angles=f"1 2 {10 * i}",
    )


MVNX = f"""<?xml version="1.0" encoding="UTF-8"?>
<mvnx xmlns="http://www.xsens.com/mvn/mvnx" version="4">
  <subject label="Somebody" frameRate="10" segmentCount="2">
    <segments>
      <segment label="Pelvis" id="1"><points><point label="p"><pos_b>0 0 0</pos_b></point></points>
      </segment>
      <segment label="L5" id="2"/>
    </segments>
    <fingerTrackingSegmentsLeft><segment label="LeftCarpus"/></fingerTrackingSegmentsLeft>
    <joints><joint label="jL5S1"><connector1>Pelvis/jL5S1</connector1></joint></joints>
    <frames segmentCount="2" jointCount="1">
{mvnx_frame(0, "npose")}{mvnx_frame(0)}{mvnx_frame(1)}{mvnx_frame(2)}    </frames>
  </subject>
</mvnx>
"""

NEXUS = """Trajectories
10
,,Anna:LASI,,,Anna:R Knee,,,Anna:*21,,
Frame,Sub Frame,X,Y,Z,X,Y,Z,X,Y,Z
,,mm,mm,mm,mm,mm,mm,mm,mm,mm
5,0,1,2,3,4,5,6,0,0,0
6,0,1.5,2.5,3.5,,,,0,0,0
8,0,-0.1,2,3,4,5,6.25,0,0,0
"""


def write(path: Path, content: str | bytes) -> Path:
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return path


def read(
    reader: Reader, path: Path, columns: tuple[str, ...] = (), rate: float | None = None
) -> JointMotion:
    return reader(path, unseen, TableOptions(columns, rate))


def refused(
    reader: Reader,
    path: Path,
    match: str,
    columns: tuple[str, ...] = (),
    rate: float | None = None,
) -> None:
    """Check that a file is refused, by one sentence that names it."""
    with pytest.raises(RecordingError, match=match) as caught:
        read(reader, path, columns, rate)
    text = str(caught.value)
    assert path.name[:37] in text
    assert "\n" not in text
    assert len(text) < 400
