"""Reading files of unknown origin, and writing files as a whole."""
