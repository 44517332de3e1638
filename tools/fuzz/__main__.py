"""Run ``python -m tools.fuzz``."""

from tools.fuzz.fuzz import main

main()
