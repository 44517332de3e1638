"""Simulated people and robots, their closed loops, and the independent checker."""
