"""Recordings: motion-capture files, read and turned into postures."""

from ergoqp.recordings.load import fit_postures as fit_postures
from ergoqp.recordings.load import load_recording as load_recording
from ergoqp.recordings.readers import READERS as READERS
from ergoqp.recordings.recording import Recording as Recording
