"""People with mass: they stand or sit by contact alone, and hold the object with a soft grasp."""

from __future__ import annotations
