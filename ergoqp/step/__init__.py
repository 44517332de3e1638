"""The control step."""
