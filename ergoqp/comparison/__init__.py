"""Comparison of QP solvers on QPs recorded from closed loops; see `compare`."""
