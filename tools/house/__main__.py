"""Run ``python -m tools.house``."""

from tools.house.house import main

main()
