"""Fit of a body's posture to joint centres."""

from __future__ import annotations
