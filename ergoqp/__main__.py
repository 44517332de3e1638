"""``python -m ergoqp``: the same as the command ``ergoqp``."""

from ergoqp.cli.main import main

if __name__ == "__main__":
    main()
