from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from sim.dynamic import dynamic
from sim.fiber_voxels import Fiber
from sim.geometry import PUBLISHED, columns
from sim.shape import Shape
from sim.sheet import Face, Sheet

ROOT = Path(__file__).parents[2]
GOLDEN = ("flat", "cylinder_known", "sphere_known", "random0_first", "random0_second")


@dataclass(frozen=True, eq=False)
class Golden:
    """A result of the reference engine (fixtures/golden)."""

    name: str
    sheet: Sheet
    dynamic_positions_m: NDArray[np.float64]
    equilibrium_positions_m: NDArray[np.float64]
    steps: int


@cache
def _load_golden(name: str) -> Golden:
    with np.load(ROOT / "fixtures" / "golden" / f"{name}.npz") as data:
        return Golden(
            name,
            Sheet(data["material"]),
            data["dynamic_positions_m"],
            data["equilibrium_positions_m"],
            int(data["steps"]),
        )


@pytest.fixture(params=GOLDEN)
def golden(request: pytest.FixtureRequest) -> Golden:
    return _load_golden(request.param)


@pytest.fixture(scope="session")
def load_golden() -> Callable[[str], Golden]:
    return _load_golden


@pytest.fixture(scope="session")
def dynamic_shape() -> Callable[[str], Shape]:
    """The dynamic run of a golden sheet, done once: several tests look at it."""

    @cache
    def run(name: str) -> Shape:
        shape = dynamic(_load_golden(name).sheet)
        assert isinstance(shape, Shape)
        return shape

    return run


def chord(face: Face, column: int | None = None, row: int | None = None) -> Fiber:
    """A fiber along a whole column (i) or row (j) of the published sheet."""
    index = column if column is not None else row
    ends = np.flatnonzero(columns(PUBLISHED)[index])[[0, -1]]
    line = [(PUBLISHED.to_sheet_m(index), PUBLISHED.to_sheet_m(int(end))) for end in ends]
    (a, b), (c, d) = line if column is not None else [point[::-1] for point in line]
    return Fiber(face, (a, b), (c, d))


@pytest.fixture(scope="session")
def known_patterns() -> dict[str, list[Fiber]]:
    """The fibers of the published target patterns, all jammed."""
    cylinder = [chord("top", column=i) for i in (6, 13, 20)]
    sphere = cylinder + [chord("top", row=j) for j in (6, 13, 20)]
    return {"flat": [], "cylinder_known": cylinder, "sphere_known": sphere}


def pair(axis: int, codes: tuple[int, int] = (1, 1)) -> Sheet:
    """Two voxels side by side along one axis."""
    material = np.zeros((28, 28, 3), np.int8)
    material[0, 0, 0] = codes[0]
    material[tuple(np.eye(3, dtype=int)[axis])] = codes[1]
    return Sheet(material)


@pytest.fixture
def voxel_pair() -> Callable[..., Sheet]:
    return pair
