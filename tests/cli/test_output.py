"""What commands print on a terminal: within its width, nothing glued together; and on a pipe, a row a line."""

import io
from contextlib import contextmanager
from unittest.mock import patch

import click

from labctl.cli.output import ProgressLine, paragraph, table


class Screen:
    """A terminal of 80 letters that stands for standard output and error both."""

    def __init__(self):
        self.rows, self.at = [""], 0

    def isatty(self):
        return True

    def flush(self):
        pass

    def write(self, text):
        if not isinstance(text, str):
            raise TypeError("a terminal of text")
        for letter in text:
            if letter == "\n":
                self.rows.append("")
                self.at = 0
            elif letter == "\r":
                self.at = 0
            else:
                if self.at == 80:
                    self.rows.append("")
                    self.at = 0
                row = self.rows[-1].ljust(self.at)
                self.rows[-1] = row[: self.at] + letter + row[self.at + 1 :]
                self.at += 1
        return len(text)

    @property
    def shown(self):
        return [row.rstrip() for row in self.rows]


@contextmanager
def on_a_screen():
    """A terminal in place of both outputs; within the test, because pytest sets them anew for it."""
    screen = Screen()
    with (
        patch.dict("os.environ", COLUMNS="80"),
        patch("sys.stdout", screen),
        patch("sys.stderr", screen),
    ):
        yield screen


def test_a_long_step_stays_in_its_line():
    with on_a_screen() as screen, ProgressLine(quiet=False) as line:
        for number in range(3):
            line.show(f"trial 1: wait until the sheet has relaxed {'x' * 100}", f"{number}")
        line.notify("a notice")
        line.show("trial 2", "0.1 psi")
        line.result("trial 1 of 2: e_t 0.5 %")
        line.show("trial 2", "0.2 psi")
    assert screen.shown == ["labctl: a notice", "trial 1 of 2: e_t 0.5 %", ""]


def test_what_others_print_is_not_glued_to_it():
    with on_a_screen() as screen, ProgressLine(quiet=False) as line:
        line.show("hold", "3.90 psi")
        line.give_way()
        click.echo("a result")
    assert screen.shown == ["a result", ""]


def test_a_table_that_is_too_wide_is_broken_at_its_blanks():
    with on_a_screen() as screen:
        table(
            ("run", "patterns", "state"),
            [("1", "sphere, cylinder, " * 5, "finished"), ("2", "x" * 20, "failed")],
        )
    assert max(map(len, screen.shown)) <= 80
    words = " ".join(" ".join(screen.shown).split())
    assert words.count("cylinder,") == 5
    assert "x" * 20 in words


def test_a_table_of_one_long_word_is_left_as_it_is():
    with on_a_screen() as screen:
        table(("word",), [("x" * 100,)])
    assert "".join(screen.shown).count("x") == 100


def test_a_table_that_fits_is_a_row_a_line():
    with on_a_screen() as screen:
        table(("run", "state"), [("1", "finished")])
    assert screen.shown == ["run     state", "  1  finished", ""]


def test_a_paragraph_keeps_commands_whole():
    with on_a_screen() as screen:
        command = "labctl vent --rig 'mein Rig.toml'"
        paragraph(f"  ok      gauge zero: {'word ' * 11}{command} opens the way out, and looks", " " * 10)
    assert max(map(len, screen.shown)) <= 80
    assert any(command in row for row in screen.shown)
    assert all(row.startswith(" " * 10) for row in screen.shown[1:-1])


def test_on_a_pipe_a_row_is_a_line(monkeypatch, capsys):
    monkeypatch.setenv("COLUMNS", "20")
    table(("patterns", "state"), [("sphere, cylinder, saddle", "finished")])
    paragraph("a line of more than twenty letters", "  ")
    assert capsys.readouterr().out.splitlines() == [
        "                patterns     state",
        "sphere, cylinder, saddle  finished",
        "a line of more than twenty letters",
    ]


def test_progress_on_a_pipe_is_a_line_a_step():
    error, out = io.StringIO(), io.StringIO()
    with patch("sys.stderr", error), patch("sys.stdout", out), ProgressLine(quiet=False) as line:
        line.show("hold", "1")
        line.show("hold", "2")
        line.result("a result")
        line.notify("a notice")
    assert error.getvalue() == "... hold\nlabctl: a notice\n"
    assert out.getvalue() == "a result\n"
