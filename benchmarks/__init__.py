"""Timings and comparisons, apart from the tests.

Run ``python -m benchmarks.NAME [--quick | --full] [--json FILE]``.
"""
