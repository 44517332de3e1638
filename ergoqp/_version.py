"""The version of the package, defined only here, and since when this process has it loaded."""

import time

__version__ = "0.1.0"

LOADED = time.time()
"""When this process began to load the package [s since 1970]."""
