"""The motion under way: the planned and sent twists, and the landing pose of the object."""
