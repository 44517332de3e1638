"""Posture sheets as data, and their exact scores."""
