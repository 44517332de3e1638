"""Links and accessibility of the site."""
