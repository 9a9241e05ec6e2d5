"""Keep two inflations in a ledger, and read them back as tables."""

from pathlib import Path
from tempfile import TemporaryDirectory

from labctl import api

with TemporaryDirectory() as folder:
    ledger = Path(folder) / "ledger"
    with api.doubles(speed=10) as rig:
        for pattern in ("sphere", "cylinder"):
            api.inflate(pattern, rig=rig, ledger=ledger, note=f"a look at the {pattern}")
    runs = api.runs(ledger=ledger)
    for run in runs:
        print(run.number, run.state, run.note)
        print(run.groups().round(2).to_string(index=False))
    points = api.run("last", ledger=ledger).points()

assert [run.state for run in runs] == ["finished", "finished"]
assert len(points) == 16 and points["counts"].all()
assert points["height_mm"].max() > 5
