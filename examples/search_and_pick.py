"""A short search for layouts that bend to a cylinder and a sphere, and a design file of what it picks."""

from pathlib import Path
from tempfile import TemporaryDirectory

from labctl import api

with TemporaryDirectory() as folder:
    found = api.search("cylinder,sphere", Path(folder) / "run", population=10, generations=3)
    front = found.front()
    print(front.round(2).to_string(index=False))
    design = Path(folder) / "mine.toml"
    found.pick(design)
    shape = api.simulate("cylinder", design=design)

assert len(front) >= 1
assert front["cylinder_mm"].min() > 0
assert shape.strain is not None
