"""Joint centres from markers on the skin."""
