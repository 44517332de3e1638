"""Biovision hierarchy files (.bvh)."""
