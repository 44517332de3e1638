"""The old name of `tools.fuzz_c`."""

from tools.fuzz_c import main

if __name__ == "__main__":
    main()
