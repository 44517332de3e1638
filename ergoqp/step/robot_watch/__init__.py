"""The fault watch: differences between what the robot did and what it was sent."""
