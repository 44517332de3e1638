"""Learning methods that costs, limits and responses use."""
