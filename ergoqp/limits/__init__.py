"""Limits as rows with names: one file per kind of row."""

from ergoqp.limits.joints import JointLimit as JointLimit
from ergoqp.limits.keep_out import Ball as Ball
from ergoqp.limits.keep_out import Box as Box
from ergoqp.limits.keep_out import HalfSpace as HalfSpace
from ergoqp.limits.keep_out import KeepOut as KeepOut
from ergoqp.limits.limit import Limit as Limit
from ergoqp.limits.limit import LimitContext as LimitContext
from ergoqp.limits.limit import Rows as Rows
from ergoqp.limits.state import ArmLength as ArmLength
from ergoqp.limits.state import OneClassBoundary as OneClassBoundary
from ergoqp.limits.twist_and_stopping import AXES as AXES
from ergoqp.limits.twist_and_stopping import TwistLimit as TwistLimit
from ergoqp.limits.workspace import AxisCone as AxisCone
from ergoqp.limits.workspace import WorkspaceBox as WorkspaceBox
