"""How the posture follows the object: S(q), one file per model."""

from ergoqp.responses.ik import IkResponse as IkResponse
from ergoqp.responses.response import LinearResponse as LinearResponse
from ergoqp.responses.response import Response as Response
