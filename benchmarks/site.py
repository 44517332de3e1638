"""The old name of `tools.site.site`."""

from tools.site.site import main

if __name__ == "__main__":
    main()
