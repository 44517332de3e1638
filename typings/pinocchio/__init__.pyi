# The module is native and ships no types: everything in it is taken as it comes.
from typing import Any

def __getattr__(name: str) -> Any: ...
