"""Identification of a person from their postures at rest: habits and lengths."""

from ergoqp.identification.identify import Identified as Identified
from ergoqp.identification.identify import identify as identify
