"""The answer of a step: the twist, its account, and the causes in words."""
