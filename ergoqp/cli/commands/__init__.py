"""What the commands do; `ergoqp.cli.main` says which there are. Imported only when a command runs, so that ``--help`` is quick."""
