"""What the commands do; `ergoqp.cli.main` says which there are.

They are imported when they run, so that ``--help`` is quick.
"""
