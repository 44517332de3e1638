"""The terms of one task, as data."""
