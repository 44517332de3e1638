"""Fit of a body's posture to joint centres."""
