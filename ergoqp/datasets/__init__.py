"""Labelled postures: drawn at random, streamed, on disk, and from tables."""
