"""The body: its segments, scaling to a person, and kinematics as expressions."""

from ergoqp.human.body import FRACTIONS as FRACTIONS
from ergoqp.human.body import FRAMES as FRAMES
from ergoqp.human.body import Body as Body
from ergoqp.human.body import Kinematics as Kinematics
