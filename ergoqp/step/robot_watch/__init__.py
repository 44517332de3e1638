"""The watch over the robot: what it does other than it was sent."""
