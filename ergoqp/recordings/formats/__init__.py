"""What motion-capture files are read, each by a reader of its own."""
