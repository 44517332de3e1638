"""Ergonomic costs V(q), one file per surrogate."""
