import pytest
from report_samples import make_recording, make_run


@pytest.fixture(scope="session")
def run():
    return make_run()


@pytest.fixture(scope="session")
def recording():
    return make_recording()
