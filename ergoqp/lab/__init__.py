"""Beside the core: people of other kinds, people with mass, baselines, groups, the report's studies."""
