"""Who stands there: what a person's rests say of their habits and of their lengths."""

from ergoqp.identification.identify import Identified as Identified
from ergoqp.identification.identify import identify as identify
