"""The old name of `tools.house.house`."""

from tools.house.house import main

if __name__ == "__main__":
    main()
