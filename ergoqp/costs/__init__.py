"""Ergonomic costs V(q), one file per kind of cost."""
