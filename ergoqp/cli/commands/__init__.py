"""The implementations of the commands; `ergoqp.cli.main` defines which there are.

They are imported when they run, so that ``--help`` is fast.
"""
