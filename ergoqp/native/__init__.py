"""CasADi functions as machine code for this computer."""
