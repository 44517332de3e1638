"""Mistakes that are put into the code, and whether the tests notice them."""
