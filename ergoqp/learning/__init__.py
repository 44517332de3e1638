"""What costs, limits and responses learn with."""
