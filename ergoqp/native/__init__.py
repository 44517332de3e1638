"""The step in C: compiled for this machine, or exported as sources for others."""
