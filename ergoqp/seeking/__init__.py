"""A loop that tries places, and judges them by the measured posture."""

from ergoqp.seeking.next_place import Place as Place
from ergoqp.seeking.next_place import SeekOptions as SeekOptions
from ergoqp.seeking.seeker import Seeker as Seeker
