"""One fixed place for several people."""
