"""The project's own recording, written once."""

from pathlib import Path

import pytest

from ergoqp.mocap.demo_recording import demo_recording


@pytest.fixture(scope="session")
def demo(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A BVH file of the demo person: 181 frames under our own joint names."""
    return demo_recording(tmp_path_factory.mktemp("recordings") / "demo.bvh")
