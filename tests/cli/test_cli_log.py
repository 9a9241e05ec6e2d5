"""`--log wire`: every byte that an inflation sends and receives, beside what the doubles heard and said."""

import re
from collections import defaultdict

import pytest
from labctl_process import run_labctl, serve_doubles

LINE = re.compile(r"\S+ (?P<link>.+?) (?P<way>[<>]) (?P<data>(?:[0-9a-f]{2} ?)+)(?:\| .*)?")
INSTRUMENTS = {"regulator": "regulator A on", "valves": "valve bank on", "markers": "marker stream on"}


def bytes_of(path):
    """What a log holds: (instrument, direction) -> bytes, in order."""
    found = defaultdict(bytearray)
    for line in path.read_text().splitlines():
        match = LINE.fullmatch(line)
        assert match, line
        (name,) = (
            name
            for name, begin in INSTRUMENTS.items()
            if match["link"].startswith(begin) or match["link"] == f"double {name}"
        )
        found[name, match["way"]] += bytes.fromhex(match["data"])
    return found


@pytest.mark.parametrize("valves", ["rtu", pytest.param("tcp", marks=pytest.mark.long)])
def test_every_byte_of_an_inflation_is_there_both_ways(tmp_path, valves):
    theirs, ours = tmp_path / "doubles.log", tmp_path / "lab.log"
    with serve_doubles(tmp_path, "--valves", valves, "--log", f"wire={theirs}") as served:
        ended = run_labctl("inflate", "--pattern", "sphere", "--rig", served.rig, "--log", f"wire={ours}")
    assert ended.code == 0, ended.err

    lab, double = bytes_of(ours), bytes_of(theirs)
    for name in INSTRUMENTS:
        assert len(lab[name, ">"]) > 0
        assert lab[name, ">"] == double[name, "<"], f"what {name} was sent"
        # What an instrument still said while its link was closed, nobody heard.
        heard, said = lab[name, "<"], double[name, ">"]
        assert said.startswith(heard), f"what {name} answered"
        assert len(said) - len(heard) < (100 if name != "markers" else 1 << 20)


@pytest.mark.parametrize("log", ["wire=/dev/full", pytest.param("all=/dev/full", marks=pytest.mark.long)])
def test_a_full_disk_keeps_no_rig_from_safe(tmp_path, log):
    with serve_doubles(tmp_path) as served:
        ended = run_labctl("inflate", "--pattern", "sphere", "--rig", served.rig, "--log", log)
        assert served.is_safe()
    assert ended.code == 0, ended.err
    assert ended.err.count("the log /dev/full could not be written") == 1
    assert "SAFE, as read back" in ended.out


def test_a_log_that_cannot_be_is_refused_before_anything_is_opened(tmp_path):
    ended = run_labctl("inflate", "--pattern", "sphere", "--log", f"wire={tmp_path}/nowhere/wire.log")
    assert ended.code == 2
    assert "cannot be written: No such file or directory; name another file" in ended.err
    ended = run_labctl("doctor", "--log", "everything")
    assert ended.code == 2
    assert "write wire, all, wire=FILE or all=FILE" in ended.err
