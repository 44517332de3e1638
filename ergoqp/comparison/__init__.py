"""Solvers against each other on QPs recorded from closed loops; see `compare`."""
