"""Joint centres from markers on the skin."""

from __future__ import annotations
