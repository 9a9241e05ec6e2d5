from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from labctl.config.load import load_design
from sim.sheet import Sheet

ROOT = Path(__file__).parents[3]


@pytest.fixture(scope="session")
def known():
    """The shipped design: fibers along y, named x35, x70 and x105, make its cylinder."""
    return load_design("known")


@pytest.fixture(scope="session")
def golden():
    """A golden result of the reference engine by name, of the published geometry."""

    def load(name):
        with np.load(ROOT / "fixtures" / "golden" / f"{name}.npz") as data:
            return SimpleNamespace(
                sheet=Sheet(data["material"]),
                at_rest_m=data["equilibrium_positions_m"],
                dynamic_m=data["dynamic_positions_m"],
            )

    return load
