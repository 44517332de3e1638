"""A loop that tries places, and judges them by the measured posture."""

from ergoqp.seeking.seeker import Seeker as Seeker
from ergoqp.seeking.tries import Place as Place
from ergoqp.seeking.tries import SeekOptions as SeekOptions
