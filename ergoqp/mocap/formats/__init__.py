"""The formats of motion-capture files, with one reader for each."""
