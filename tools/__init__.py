"""Tools that judge the project: fuzz, mutants, house, site, and whether commits answer the same."""
