"""Doubles in this process: real bytes, a sheet without the simulator's cost."""

import pytest
from bowl import DESIGN, Bowl

from labctl.config.load import load_rig
from labctl.doubles.faults import parse_faults
from labctl.doubles.serve import Doubles
from labctl.doubles.settings import DoublesSettings


@pytest.fixture
def serve(tmp_path):
    """Doubles with faults, and the configuration that points at them."""
    opened = []

    def begin(*faults, speed=5.0, **settings):
        doubles = Doubles(
            DoublesSettings(DESIGN, speed=speed, faults=parse_faults(faults), **settings), shapes=Bowl()
        )
        opened.append(doubles)
        path = tmp_path / "rig.toml"
        path.write_text(doubles.rig_toml())
        return doubles, load_rig(path)

    yield begin
    for doubles in opened:
        doubles.close()
