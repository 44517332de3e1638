"""Small CasADi tools."""
