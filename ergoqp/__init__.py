"""ergoqp: the robot moves the object so that the person's posture gets better."""

from ergoqp.joints import JOINTS as JOINTS
from ergoqp.sheets import reba as reba

__version__ = "0.1.0"
