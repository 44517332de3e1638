"""The answer of a step: the twist, its account, and the reason in words."""
