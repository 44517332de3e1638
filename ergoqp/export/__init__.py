"""The step as C99 for other machines."""
