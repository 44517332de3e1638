"""What all tests share."""

import os
from pathlib import Path

import pytest

# Several processes test at once: threads of the linear algebra would only wait for each other.
os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")


@pytest.fixture(scope="session")
def shared() -> Path:
    """The project's shared folder of reference data, in the checkout or beside it; tests that read
    it skip without."""
    found = (parent / "shared" for parent in Path(__file__).resolve().parents)
    folder = next((folder for folder in found if (folder / "reba").is_dir()), None)
    if folder is None:
        pytest.skip(
            "the folder 'shared' with the reference data is neither in the checkout nor beside it"
        )
    return folder
