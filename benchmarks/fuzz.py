"""The old name of `tools.fuzz.fuzz`."""

from tools.fuzz.fuzz import main

if __name__ == "__main__":
    main()
