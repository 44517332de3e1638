"""Beside the core: people of other kinds and with mass, baselines, groups, the report's studies."""
