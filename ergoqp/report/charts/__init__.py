"""Charts as SVG, and box plots."""
