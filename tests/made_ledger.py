"""Records that are full of what could get lost on the way to a file and back, and ledgers of them."""

import json
import sqlite3
from contextlib import closing, contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path

from labctl.instruments.readings import Identity
from labctl.ledger.ledger import Ledger
from labctl.ledger.moment import Moment
from labctl.ledger.records import (
    EventRecord,
    RawFile,
    RunRecord,
    RunRequest,
    SafeReadBack,
    SimulatedHeights,
    TrialRecord,
)
from labctl.ledger.writer import LedgerWriter
from labctl.measurement.result import LevelResult, TrialResult
from labctl.measurement.windows import Window

BEGUN = Moment("2026-03-01T09:00:00.000001+01:00", 1234.000000001, "boot-a")
ENDED = Moment("2026-03-01T09:01:00.250000+01:00", 1294.25, "boot-a")
REQUEST = RunRequest("five-trial", ("sphere",), (3.9,), 5, 3, ("neat",), None)


def a_run(**changes):
    run = RunRecord(
        number=0,
        protocol="five-trial",
        begun=BEGUN,
        request=REQUEST,
        planned_trials=5,
        design_name="known",
        design_source="designs/known.toml",
        design_text='# µ, "quotes", a line\nand another\u2028',
        rig_name="bench",
        rig={"limits": {"max_pressure_psi": 4.0}, "dump_channel": None},
        simulated=True,
        identities={"regulator": Identity("PCD")},
        simulated_heights=(SimulatedHeights("sphere", 3.9, (6.5, 5e-324, 0.1 + 0.2)),),
        versions={"labctl": "0.1.0"},
        commit=None,
        operator="Ada",
        note="typed in another code page: \udcfc",
    )
    return replace(run, **changes)


def a_result(**changes):
    level = LevelResult(
        pressure_psi=3.9,
        mean_psi=0.1 + 0.2,
        lowest_psi=None,
        highest_psi=3.91,
        frames=960,
        heights_mm=(1.7976931348623157e308, None, -0.0),
        height_sd_mm=(0.1, None, 0.0),
        seen=(960, 0, 1),
        points_compared=2,
        per_point_percent=(None, None, 17.1),
        e_t_percent=17.1,
    )
    return TrialResult(None, 0.2, (replace(level, **changes),), None, ())


def a_trial(run, number=1, attempt=1, **changes):
    trial = TrialRecord(
        run=run,
        number=number,
        attempt=attempt,
        placement="neat",
        pattern="sphere",
        pressures_psi=(2.6, 3.9),
        begun=BEGUN,
        ended=ENDED,
        outcome="good",
        reason="",
        windows=(Window("level", 1 / 3, 5e-324, 3.9),),
        raw={"frames": RawFile("raw/0001-five-trial/trial-01-1.frames.parquet", "ab" * 32, 10**12)},
        result=a_result(),
        safe=SafeReadBack(safe=True, words="SAFE"),
    )
    return replace(trial, **changes)


def an_event(run, kind="paused", **detail):
    return EventRecord(run, kind, ENDED, detail)


@dataclass
class Notices:
    """The notices that a ledger gave: its `notify`."""

    lines: list = field(default_factory=list)

    def __call__(self, text):
        self.lines.append(text)

    @property
    def text(self):
        return "\n".join(self.lines)


@dataclass
class Kept:
    """A ledger's folder, and what was committed to it."""

    folder: Path
    run: RunRecord
    trials: tuple

    @property
    def sqlite(self):
        return self.folder / "ledger.sqlite"

    @property
    def journal(self):
        return self.folder / "ledger.journal"

    def check_all_there(self, notify):
        """Open it to write, and find everything."""
        with LedgerWriter.open(self.folder, notify) as ledger:
            self.check(ledger)
        with Ledger.open(self.folder, no_notice) as ledger:
            self.check(ledger)
        check_files_agree(self.folder)

    def check(self, ledger):
        assert ledger.runs() == (self.run,)
        assert ledger.trials(self.run.number) == self.trials


def make_ledger(folder, trials=6):
    """A ledger of a run with some trials and an event after each, its writer gone."""
    with LedgerWriter.open(folder, no_notice) as writer:
        run = writer.begin_run(a_run())
        for number in range(1, trials + 1):
            writer.add_trial(a_trial(run.number, number))
            writer.add_event(an_event(run.number, "paused", after=number))
        return Kept(folder, run, writer.trials(run.number))


def no_notice(text):
    raise AssertionError(f"notice: {text}")


def check_files_agree(folder):
    """The rows of the journal are those of SQLite, number by number and checksum by checksum."""
    lines = [json.loads(line) for line in (folder / "ledger.journal").read_bytes().splitlines()[1:]]
    with closing(sqlite3.connect(folder / "ledger.sqlite")) as connection:
        query = " UNION ALL ".join(
            f"SELECT seq, checksum FROM {table}"  # noqa: S608 - names of ours
            for table in ("runs", "trials", "events")
        )
        stored = sorted(connection.execute(query))
        assert connection.execute("PRAGMA integrity_check").fetchone() == ("ok",)
    assert stored == [(line["seq"], line["sha256"]) for line in lines]


@contextmanager
def changed_bytes(path):
    """The bytes of a file, to be changed in place."""
    data = bytearray(path.read_bytes())
    yield data
    path.write_bytes(data)
