"""The vendor's `owl.py`, from where the user has it: argv is its folder and host:N of the marker server."""

import sys
from typing import Any

from operations import Operations

FRAMES = 240


def main() -> None:
    """Frames over TCP, UDP and broadcast, then every command."""
    folder, address = sys.argv[1:3]
    sys.path.insert(0, folder)
    import owl

    client = owl.Context()
    operations = Operations()
    run = operations.run
    run("open", lambda: client.open(address, "timeout=5000000"), lambda value: value == 1)
    for streaming, name in ((1, "TCP"), (2, "UDP"), (3, "broadcast")):
        run(f"initialize ({name})", lambda: client.initialize("event.markers=1 timebase=1,1000000"))
        run(f"streaming {streaming}", lambda mode=streaming: client.streaming(mode))
        run(f"{FRAMES} frames by {name}", lambda: frames(owl, client), lambda good: good == FRAMES)
        if streaming == 1:
            commands(owl, client, operations)
        run(f"done ({name})", client.done, lambda value: value == 1)
    run("close", client.close)


def frames(owl: Any, client: Any) -> int:  # noqa: ANN401 - the vendor's module has no types
    """How many of the next frames carry all markers and go on in time."""
    good, last, idle = 0, -1, 0
    while good < FRAMES and idle < 50:
        event = client.nextEvent(100_000)
        idle = idle + 1 if event is None else 0
        if event is None or event.type_id != owl.Type.FRAME or "markers" not in event:
            continue
        good += len(event.markers) == client.property("markers") and event.time > last
        last = event.time
    return good


def commands(owl: Any, client: Any, operations: Operations) -> None:  # noqa: ANN401 - likewise
    """Set everything, let the answers come, and look at what the client holds then."""
    run = operations.run
    run("createTracker", lambda: client.createTracker(1, "point", "sheet"))
    run("assignMarker", lambda: client.assignMarker(1, 3, "three"))
    run("markerName", lambda: client.markerName(4, "four"))
    run("markerOptions", lambda: client.markerOptions(4, "size=2"))
    run("trackerName", lambda: client.trackerName(1, "plate"))
    run("trackerOptions", lambda: client.trackerOptions(1, "colour=red"))
    run("filter", lambda: client.filter(120, "slow", "type=lerp"))
    run("frequency 120", lambda: client.frequency(120))
    run("scale 0.5", lambda: client.scale(0.5))
    run("option", lambda: client.option("system.LEDPower", 0.5))
    run("createTracker rigid", lambda: client.createTracker(2, "rigid", "body"))
    errors = []
    for _ in range(300):
        event = client.nextEvent(5000)
        if event is not None and event.type_id == owl.Type.ERROR:
            errors.append(event.data.decode())
    run("markerInfo", lambda: client.markerInfo(3).tracker_id, lambda tracker: tracker == 1)
    run("trackerInfo", lambda: client.trackerInfo(1).name, lambda name: name == "plate")
    run("filterInfo", lambda: client.filterInfo("slow").period, lambda period: period == 120)
    run("frequency as answered", client.frequency, lambda value: value == 120)
    run("scale as answered", client.scale, lambda value: value == 0.5)
    run("option as answered", lambda: client.option("system.LEDPower"), lambda value: float(value) == 0.5)
    run("errors in words, the link kept", lambda: errors, lambda texts: len(texts) == 1)


if __name__ == "__main__":
    main()
