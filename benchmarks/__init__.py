"""Timings and comparisons, apart from the tests: ``python -m benchmarks.NAME [--quick | --full] [--json FILE]``."""
