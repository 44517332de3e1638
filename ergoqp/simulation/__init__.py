"""People who follow, a robot that moves, the closed loop of both; the independent checker."""
