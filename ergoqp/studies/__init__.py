"""The EPFL report's forearm and its learned policy."""
