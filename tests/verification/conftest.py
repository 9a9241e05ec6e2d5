"""The recording that most tests begin from."""

import pytest
from made_recording import made_trial


@pytest.fixture
def trial():
    return made_trial()
