"""Drawings of the person."""
