"""The shape of the package."""
