"""Studies of the EPFL report: the forearm, and the learned policy."""
