"""Recordings: motion-capture files, read and turned into postures."""

from __future__ import annotations

from ergoqp.mocap.load import fit_postures as fit_postures
from ergoqp.mocap.load import load_recording as load_recording
from ergoqp.mocap.readers import READERS as READERS
from ergoqp.mocap.recording import Recording as Recording
