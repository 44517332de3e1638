"""Run ``python -m tools.mutants``."""

from tools.mutants.mutants import main

main()
