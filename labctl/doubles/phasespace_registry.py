"""What a PhaseSpace server keeps of trackers, markers and filters, and the tables by which clients hear of them.

Source: docs/reference/phasespace-wire.md, sections on text and session. A real server's limits are not known: here
trackers are of points, and markers are those of the sheet.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

DEFAULT_TRACKER = 0
_LARGEST_NAME = 255
# In the table of names: the name of a filter.
_FILTER_FLAGS = 2
# A table is one packet, which clients take up to 4 MiB; these keep it far below.
_MOST_ROWS = 1000
_MOST_OPTION_CHARACTERS = 1000


class RefusedError(Exception):
    """A command that is not served; its text is the answer."""


@dataclass
class _Entry:
    """Name and options of a tracker or marker, and the tracker that a marker belongs to."""

    name: str
    options: dict[str, str] = field(default_factory=dict)
    tracker: int = DEFAULT_TRACKER

    def words(self) -> str:
        """Name and options as a row of a table ends."""
        return " ".join([self.name, *(f"{key}={value}" for key, value in self.options.items())])


class Registry:
    """Trackers, markers and filters; each command takes its text and raises `RefusedError` with the reason.

    `names` are the server's own names with their numbers; filters get those that follow.
    """

    def __init__(self, markers: Iterable[int], names: Mapping[str, int]) -> None:
        self._names = names
        self._trackers = {DEFAULT_TRACKER: _Entry("default")}
        self._markers = {marker: _Entry(str(marker)) for marker in markers}
        self._filters: dict[str, dict[str, str]] = {}

    def tables(self) -> list[str]:
        """The tables of trackers and, after it, of markers."""
        trackers = (f"id={id_},{id_},point,{entry.words()}" for id_, entry in self._trackers.items())
        markers = (f"id={id_},{entry.tracker},{entry.words()}" for id_, entry in self._markers.items())
        return [" ".join(["table=trackers", *trackers]), " ".join(["table=markers", *markers])]

    def filter_tables(self) -> list[str]:
        """The names of the filters and, after it, each filter's period and options."""
        first = max(self._names.values()) + 1
        names = (f"{first + place}={name},{_FILTER_FLAGS}" for place, name in enumerate(self._filters))
        filters = (
            " ".join([f"filter={name}", *(f"{key}={value}" for key, value in options.items())])
            for name, options in self._filters.items()
        )
        return [" ".join(["table=names", *names]), " ".join(filters)]

    def create_trackers(self, content: str) -> None:
        """`id=1 type=point name=n mid=0,1 opts ...`; the name defaults to the id."""
        made = dict[int, tuple[_Entry, list[_Entry]]]()
        for record in _records(content, "id"):
            kind = record.pop("type", "point")
            if kind != "point":
                raise RefusedError(f"createtracker: type {kind!r} is not served here, only point")
            tracker = _whole(record.pop("id"), "createtracker: id")
            members = [self._marker(mid, "createtracker") for mid in _listed(record.pop("mid", ""))]
            made[tracker] = (_Entry(_name(record.pop("name", str(tracker))), _options(record)), members)
        if len(self._trackers | made) > _MOST_ROWS:
            raise RefusedError(f"createtracker: more than {_MOST_ROWS} trackers are not served here")
        for tracker, (entry, members) in made.items():
            self._trackers[tracker] = entry
            for member in members:
                member.tracker = tracker

    def destroy_trackers(self, content: str) -> None:
        """`id=1,2`; their markers go back to the default tracker, which stays."""
        for record in _records(content, "id"):
            for tracker in [self._tracker_id(text, "destroytracker") for text in _listed(record["id"])]:
                if tracker == DEFAULT_TRACKER:
                    raise RefusedError(
                        f"destroytracker: tracker {tracker} holds the markers of no other, it stays"
                    )
                self._trackers.pop(tracker, None)
                for marker in self._markers.values():
                    if marker.tracker == tracker:
                        marker.tracker = DEFAULT_TRACKER

    def assign_markers(self, content: str) -> None:
        """`tid=1 mid=0 name=n opts ...`."""
        for record in _records(content, "tid"):
            tracker = self._tracker_id(record.pop("tid"), "assignmarker")
            marker = self._marker(record.pop("mid", ""), "assignmarker")
            marker.name = _name(record.pop("name", marker.name))
            marker.options = _options(marker.options | record)
            marker.tracker = tracker

    def name_tracker(self, content: str) -> None:
        """`id=1 name=n`."""
        for record in _records(content, "id"):
            tracker = self._trackers[self._tracker_id(record["id"], "trackername")]
            tracker.name = _name(record.get("name", ""))

    def set_tracker_options(self, content: str) -> None:
        """`id=1 opts`."""
        for record in _records(content, "id"):
            tracker = self._trackers[self._tracker_id(record.pop("id"), "trackeroptions")]
            tracker.options = _options(tracker.options | record)

    def name_marker(self, content: str) -> None:
        """`mid=1 name=n`."""
        for record in _records(content, "mid"):
            self._marker(record["mid"], "markername").name = _name(record.get("name", ""))

    def set_marker_options(self, content: str) -> None:
        """`mid=1 opts`."""
        for record in _records(content, "mid"):
            marker = self._marker(record.pop("mid"), "markeroptions")
            marker.options = _options(marker.options | record)

    def define_filters(self, content: str) -> None:
        """`filter=n period=120 type=lerp ...`."""
        for record in _records(content, "filter"):
            name = _name(record.pop("filter"))
            _whole(record.get("period", ""), f"filter {name}: period")
            if name in self._names:
                raise RefusedError(f"filter: {name} is a name of the server's own")
            if max(self._names.values()) + len(self._filters.keys() | {name}) > _LARGEST_NAME:
                raise RefusedError(f"filter: the names end at {_LARGEST_NAME}")
            self._filters[name] = _options(record)

    def _tracker_id(self, text: str, command: str) -> int:
        tracker = _whole(text, f"{command}: tracker")
        if tracker not in self._trackers:
            raise RefusedError(f"{command}: there is no tracker {tracker}")
        return tracker

    def _marker(self, text: str, command: str) -> _Entry:
        marker = _whole(text, f"{command}: marker")
        if marker not in self._markers:
            raise RefusedError(f"{command}: the sheet has no marker {marker}")
        return self._markers[marker]


def _records(content: str, first_key: str) -> list[dict[str, str]]:
    """The records of a text, at least one; each begins at a word with the key `first_key`."""
    records: list[dict[str, str]] = []
    for word in content.split():
        key, _, value = word.partition("=")
        if key == first_key:
            records.append({})
        if records:
            records[-1][key] = value
    if not records:
        raise RefusedError(f"no {first_key}= in {content[:80]!r}")
    return records


def _whole(text: str, what: str) -> int:
    if not (text.isascii() and text.isdecimal() and len(text) <= 9):
        raise RefusedError(f"{what} {text[:80]!r} is no whole number")
    return int(text)


def _listed(text: str) -> list[str]:
    return text.split(",") if text else []


def _name(text: str) -> str:
    if not text or "," in text or "=" in text or len(text) > _MOST_OPTION_CHARACTERS:
        raise RefusedError(
            f"{text[:80]!r} is no name: a table carries short ones without comma and equals sign"
        )
    return text


def _options(record: dict[str, str]) -> dict[str, str]:
    """Options as a table can carry them: it is cut at every "id=", wherever it stands."""
    for key, value in record.items():
        if key.endswith("id") or "=" in value:
            raise RefusedError(f"option {key[:80]}={value[:80]} cannot be carried by a table")
    if sum(len(key) + len(value) for key, value in record.items()) > _MOST_OPTION_CHARACTERS:
        raise RefusedError(f"options of more than {_MOST_OPTION_CHARACTERS} characters are not served here")
    return record
