"""labctl from a program of your own: doubles, a rig, an inflation, runs as tables, a simulated shape, a search.

What stands here stays as it is from version to version; everything else in the packages is for labctl itself. Errors
are those of `labctl.errors`, all of them `LabError`. docs/how-to/use-from-python.md walks through it.
"""

from labctl.shadowed import shadowed

if (_why := shadowed()) is not None:
    raise ImportError(_why)

from labctl.api.measuring import Inflation, inflate
from labctl.api.rigs import doubles, open_rig
from labctl.api.runs import Run, run, runs
from labctl.api.searching import Search, load_search, search
from labctl.api.simulating import Simulation, simulate
from labctl.errors import BadInput, InstrumentError, LabError, Stopped, Tripped, Unsafe

__all__ = [
    "BadInput",
    "Inflation",
    "InstrumentError",
    "LabError",
    "Run",
    "Search",
    "Simulation",
    "Stopped",
    "Tripped",
    "Unsafe",
    "doubles",
    "inflate",
    "load_search",
    "open_rig",
    "run",
    "runs",
    "search",
    "simulate",
]
