"""Person, robot and object in one model, by mink: the control step in the robot's joints.

The joints of the robot are unknowns of the QP.

Needs the extra ``mink``.
"""

from ergoqp.errors import MissingExtraError

try:
    import mink as _mink  # noqa: F401
except ImportError as error:
    raise MissingExtraError("the whole-body formulation", "mink", "mink") from error

from ergoqp.whole_body.robot import Robot as Robot
from ergoqp.whole_body.robot import load_robot as load_robot
from ergoqp.whole_body.scene import Scene as Scene
from ergoqp.whole_body.whole_body import WholeBody as WholeBody
from ergoqp.whole_body.whole_body import WholeBodyStep as WholeBodyStep
