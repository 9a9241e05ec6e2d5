"""Problems that cost nothing to score, importable by worker processes of any kind."""

import os
import time
from dataclasses import dataclass
from pathlib import Path

from evolve.problem import MapScore, VoxelMap


def cheap_maps(count):
    return [VoxelMap(n.to_bytes(4, "big"), b"") for n in range(count)]


@dataclass(frozen=True)
class Cheap:
    """The error of map n is n / 7; each takes a while, and leaves its worker's process id in a file if asked to."""

    takes_s: float = 0.0
    seen: Path | None = None

    def score(self, voxel_map):
        time.sleep(self.takes_s)
        n = int.from_bytes(voxel_map.material, "big")
        if self.seen is not None:
            with (self.seen / str(os.getpid())).open("a") as file:
                file.write(f"{n}\n")
        return MapScore((n / 7, 1 / (1 + n)))


@dataclass(frozen=True)
class Deadly(Cheap):
    """Map 0 kills whoever takes it."""

    def score(self, voxel_map):
        if not int.from_bytes(voxel_map.material, "big"):
            os._exit(1)
        return super().score(voxel_map)
