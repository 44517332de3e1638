"""The old name of `tools.same`."""

from tools.same import main

if __name__ == "__main__":
    main()
