"""The old name of `tools.mutants.mutants`."""

from tools.mutants.mutants import main

if __name__ == "__main__":
    main()
