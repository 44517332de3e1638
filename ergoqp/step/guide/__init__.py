"""A place to be drawn to: what it adds to the objective, and its trial."""
