"""Rigs of doubles in virtual time."""

import pytest
from virtual_rig import VirtualRig


@pytest.fixture
def rig_with():
    """Make rigs with faults or settings; they are closed when the test ends."""
    made = []

    def make(*faults, **settings):
        made.append(VirtualRig(*faults, **settings))
        return made[-1]

    yield make
    for one in made:
        one.close()
        assert one.time.failures == []
