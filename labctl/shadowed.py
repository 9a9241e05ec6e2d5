"""Files of somebody's own that stand in the way of packages of ours: `sim.py` or `protocols/` beside a script."""

import importlib.util
from pathlib import Path

OURS = ("sim", "evolve", "protocols")


def shadowed() -> str | None:
    """What would be imported in place of a package that labctl brings, and what to do; None where nothing would."""
    home = Path(__file__).resolve().parent.parent
    for name in OURS:
        found = importlib.util.find_spec(name)
        if found is None:
            return f"the package {name}, which comes with labctl, is not there: install labctl again"
        places = [found.origin] if found.origin else list(found.submodule_search_locations or ())
        for place in map(Path, places):
            if home / name not in (place.resolve(), place.resolve().parent):
                return (
                    f"{place} is imported in place of the package {name} that comes with labctl: rename it, or run "
                    "from another folder"
                )
    return None
