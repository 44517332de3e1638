"""Hostile inputs for the step, and the independent judges of what it answers."""
