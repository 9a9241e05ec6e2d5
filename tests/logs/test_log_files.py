"""Logs that nobody waits for, in files that hold every byte."""

import logging
import os
import re
import threading
import time

import pytest

from labctl.errors import BadInput
from labctl.logs.files import (
    LogChoice,
    QueuedWriter,
    logged_as_environment_says,
    logged_to_file,
    logged_to_terminal,
)
from labctl.logs.wire import LOGGER, log_received, log_sent


def no_notice(text):
    raise AssertionError(f"notice: {text}")


def wait_until(condition):
    end_s = time.monotonic() + 10.0
    while not condition():
        assert time.monotonic() < end_s
        time.sleep(0.01)


def test_what_the_option_may_be(tmp_path):
    assert LogChoice.parse("wire").path.name == "labctl-wire.log"
    assert LogChoice.parse("all").kind == "all"
    chosen = LogChoice.parse(f"wire={tmp_path}/a=b.log")
    assert str(chosen.path) == f"{tmp_path}/a=b.log"
    assert LogChoice.parse(chosen.for_environment()) == chosen
    for text in ("", "wires", "wire=", "file.log"):
        with pytest.raises(BadInput, match="write wire, all, wire=FILE or all=FILE"):
            LogChoice.parse(text)


def test_a_line_has_time_link_direction_and_the_bytes_twice(tmp_path):
    path = tmp_path / "wire.log"
    with logged_to_file(LogChoice("wire", path), no_notice):
        log_sent("regulator A on /dev/ttyUSB0", b"AS3.90\r")
        log_received("valve bank on /dev/ttyUSB1", bytes.fromhex("01 01 01 00 51 88"))
        log_received("valve bank on /dev/ttyUSB1", b"")
        logging.getLogger("labctl.rig").debug("not of the wire")

    sent, received = path.read_text().splitlines()
    stamp = r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\d\.\d{6}\+00:00"
    assert re.fullmatch(stamp + r" regulator A on /dev/ttyUSB0 > 41 53 33 2e 39 30 0d \| AS3\.90\.", sent)
    assert re.fullmatch(stamp + r" valve bank on /dev/ttyUSB1 < 01 01 01 00 51 88", received)


def test_without_a_handler_nothing_is_formatted(monkeypatch):
    monkeypatch.setattr("labctl.logs.wire.WireBytes", None)
    assert not LOGGER.isEnabledFor(logging.DEBUG)
    log_sent("regulator A", b"A\r")


def test_all_has_the_rest_too_and_a_terminal_has_only_that(tmp_path, capsys):
    path = tmp_path / "all.log"
    with logged_to_file(LogChoice("all", path), no_notice), logged_to_terminal():
        log_sent("regulator A", b"A\r")
        logging.getLogger("labctl.rig").info("opened")
    assert [line.split(" ", 1)[1] for line in path.read_text().splitlines()] == [
        "regulator A > 41 0d | A.",
        "labctl.rig: opened",
    ]
    (line,) = capsys.readouterr().err.splitlines()
    assert line.endswith("labctl.rig: opened")


def test_a_file_that_cannot_be_opened_is_refused(tmp_path):
    os.mkfifo(tmp_path / "pipe")
    for name in ("pipe", "nowhere/wire.log", "."):
        with (
            pytest.raises(BadInput, match=r"cannot be written: .*; name another file"),
            logged_to_file(LogChoice("wire", tmp_path / name), no_notice),
        ):
            pass


def test_a_disk_that_is_full_is_reported_once_and_hinders_nobody():
    notices = []
    with logged_to_file(LogChoice.parse("wire=/dev/full"), notices.append):
        for _ in range(1000):
            log_sent("regulator A", b"A\r")
    (notice,) = notices
    assert "the log /dev/full could not be written" in notice
    assert "No space left on device" in notice
    assert "the rig is not affected" in notice


def test_a_writer_that_is_stuck_holds_up_nobody_and_what_is_lost_is_counted():
    free, lines = threading.Event(), []

    def write(line):
        free.wait(10.0)
        lines.append(line)

    writer = QueuedWriter(write, lambda _: None, queued=100)
    logger = logging.getLogger("stuck")
    logger.setLevel(logging.DEBUG)
    logger.propagate = False
    logger.addHandler(writer)
    begin = time.monotonic()
    for number in range(10_000):
        logger.debug("%d", number)
    assert time.monotonic() - begin < 5.0
    free.set()
    wait_until(lambda: len(lines) >= 100)
    logger.debug("last")
    wait_until(lambda: "last" in lines)
    logger.removeHandler(writer)
    writer.close()

    numbers = [int(line) for line in lines if line.isdigit()]
    left_out = sum(int(line.split()[1]) for line in lines if "were left out here" in line)
    assert numbers == sorted(set(numbers))
    assert len(numbers) + left_out == 10_000


def test_a_gap_stands_where_the_records_are_missing():
    free, lines = threading.Event(), []

    def write(line):
        lines.append(line)
        free.wait(10.0)

    writer = QueuedWriter(write, lambda _: None, queued=5)
    begun = logging.makeLogRecord({"msg": "0"})
    writer.emit(begun)
    wait_until(lambda: lines)
    for number in range(1, 9):
        writer.emit(logging.makeLogRecord({"msg": str(number)}))
    free.set()
    wait_until(lambda: len(lines) == 6)
    writer.emit(logging.makeLogRecord({"msg": "9"}))
    writer.close()

    assert [line.split()[1] if line.startswith("...") else line for line in lines] == [*"012345", "3", "9"]


def test_a_record_that_cannot_be_formatted_costs_that_record_only():
    lines, failures = [], []
    writer = QueuedWriter(lines.append, failures.append)
    for record in ({"msg": "%d", "args": ("x",)}, {"msg": "right"}):
        writer.emit(logging.makeLogRecord(record))
    writer.close()

    assert lines == ["right"]
    assert isinstance(failures[0], TypeError)


def test_the_file_is_opened_on_the_writers_thread_and_closed_there(tmp_path, monkeypatch):
    """A disk that hangs must not keep a guard from venting."""
    opened, here = [], threading.get_ident()
    path, real = tmp_path / "wire.log", os.open

    def watched(name, *flags):
        if str(name) == str(path):
            opened.append((threading.get_ident(), real(name, *flags)))
            return opened[-1][1]
        return real(name, *flags)

    monkeypatch.setattr("labctl.logs.files.os.open", watched)
    monkeypatch.setenv("LABCTL_LOG", f"wire={path}")
    with logged_as_environment_says(no_notice):
        assert opened == []
        log_sent("regulator A", b"A\r")
    ((thread, descriptor),) = opened
    assert thread != here
    with pytest.raises(OSError, match="Bad file descriptor"):
        os.fstat(descriptor)


def test_a_program_without_options_finds_its_log_in_the_environment(tmp_path, monkeypatch):
    path = tmp_path / "wire.log"
    monkeypatch.setenv("LABCTL_LOG", f"wire={path}")
    with logged_as_environment_says(no_notice):
        log_sent("regulator A", b"A\r")
    assert "regulator A > 41 0d" in path.read_text()

    notices = []
    monkeypatch.setenv("LABCTL_LOG", "nonsense")
    with logged_as_environment_says(notices.append):
        log_sent("regulator A", b"A\r")
    assert "write wire, all" in notices[0]
