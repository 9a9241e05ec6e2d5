"""What takes long reports how far it is, after two seconds."""

from labctl.cli.slow_progress import SlowProgress


class Line:
    """A progress line that keeps what is shown."""

    def __init__(self, *, live):
        self.live = live
        self.shown = []

    def show(self, step, detail=""):
        self.shown.append(f"{step} {detail}".strip())


def run_for(seconds, *, live):
    """A run of so many seconds whose steps come a hundred a second."""
    line, clock = Line(live=live), [0.0]
    progress = SlowProgress(line, "simulating", lambda: clock[0])
    steps = round(100 * seconds)
    for done in range(1, steps + 1):
        clock[0] = done / 100
        progress(done, steps)
    return line.shown


def test_what_is_done_in_two_seconds_is_not_worth_a_word():
    assert run_for(2.0, live=True) == run_for(2.0, live=False) == []


def test_a_terminal_sees_it_from_two_seconds_on_twice_a_second():
    shown = run_for(10.0, live=True)
    assert shown[0] == "simulating 20 % of 1000 steps, about 8 s left"
    assert shown[1] == "simulating 25 % of 1000 steps, about 8 s left"
    assert len(shown) == 16


def test_a_log_has_a_line_every_ten_seconds():
    shown = run_for(37.0, live=False)
    assert shown[:2] == [
        "simulating: 5 % of 3700 steps, about 35 s left",
        "simulating: 32 % of 3700 steps, about 25 s left",
    ]
    assert len(shown) == 4
