import base64
import re
from dataclasses import replace
from html.parser import HTMLParser

import made_measurement as made
import pytest

from labctl.errors import BadInput, LabError
from labctl.measurement.result import DoubtedPoint
from labctl.report.run.group_tables import comparison_table, format_unmatched
from labctl.report.run.page import SIMULATED, run_page, write_run_page
from labctl.report.run.view import run_view


class Seen(HTMLParser):
    """What a page shows: pictures, tags, the rows that do not count, and all its text."""

    def __init__(self, page):
        super().__init__()
        self.pictures, self.tags, self.text, self.dimmed = [], [], "", []
        self._in_dimmed = False
        self.feed(page)
        self.text = self.text.replace("\u00a0", " ")

    def handle_starttag(self, tag, attributes):
        self.tags.append(tag)
        if tag == "img":
            self.pictures.append(dict(attributes))
        if tag == "tr":
            self._in_dimmed = dict(attributes).get("class") == "dimmed"
            if self._in_dimmed:
                self.dimmed.append("")

    def handle_data(self, data):
        self.text += data
        if self._in_dimmed:
            self.dimmed[-1] += data


def view_of(run, trials=None, state="finished", read=None):
    trials = made.five_trials(run) if trials is None else trials
    return run_view(
        run,
        state,
        trials,
        made.events(run, "finished"),
        read or (lambda trial: made.pressures(seed=trial.number)),
    )


@pytest.fixture(scope="module")
def five(tmp_path_factory):
    """The page of five good trials, one of them at its second attempt; and its folder."""
    folder = tmp_path_factory.mktemp("page")
    write_run_page(folder / "page.html", [view_of(made.run())])
    return folder


def test_a_page_holds_everything_in_itself(five):
    page = (five / "page.html").read_text(encoding="utf-8")
    seen = Seen(page)

    # The sheet, e_t of the trials, heights, where they are off, pressures.
    assert len(seen.pictures) == 5
    for picture in seen.pictures:
        kind, content = picture["src"].split(",")
        assert kind == "data:image/svg+xml;base64"
        assert b"<svg" in base64.b64decode(content)
        assert picture["alt"]
    assert not {"script", "link", "iframe"} & set(seen.tags)
    assert not re.search(r"https?://", page)
    assert [entry.name for entry in five.iterdir()] == ["page.html"]


def test_a_page_says_what_came_out_and_where_from(five):
    text = Seen((five / "page.html").read_text(encoding="utf-8")).text

    assert re.search(r"Sphere at 3\.90 psi: e_t \d\.\d\d % ± \d\.\d\d % over 5 trials", text)
    assert SIMULATED in text
    for words in (
        "218899",
        "10v06",
        "PhaseSpace X2E",
        "16abf08c7fc5fe262f4b4",
        "Ada",
        "numpy 2.3.1",
        64 * "a",
    ):
        assert words in text
    # Clock offset and drift, frames and those lost, the design's own text.
    for words in ("4930.0000", "+1.2", "9600", 'rated_pressure = "3.9 psi"'):
        assert words in text


def test_every_attempt_is_listed_and_failed_ones_visibly_do_not_count(five):
    seen = Seen((five / "page.html").read_text(encoding="utf-8"))

    assert len(seen.dimmed) == 1
    assert "no, failed: the pressure left 3.90 ± 0.10 psi" in seen.dimmed[0]


def test_the_same_run_makes_the_same_page(five):
    assert run_page([view_of(made.run())]) == (five / "page.html").read_text(encoding="utf-8")


def test_what_people_wrote_is_shown_as_written_and_does_nothing(tmp_path):
    evil = "<script>alert(1)</script> $x_{1}$ {{ 7*7 }} " + "long" * 30
    run = made.run(
        note=evil,
        operator=evil,
        design_name=evil,
        rig_name=evil,
        design_text="<b>no design",
        patterns=(evil,),
    )
    trials = [
        made.trial(run, 1, pattern=evil, placement=evil),
        made.trial(run, 2, pattern=evil, placement=evil, outcome="failed", reason=evil),
    ]
    # Half of a letter, as a terminal of another code page leaves it.
    run = replace(run, note=evil + "\udcfc")
    write_run_page(tmp_path / "page.html", [view_of(run, trials)])
    seen = Seen((tmp_path / "page.html").read_text(encoding="utf-8"))

    assert "script" not in seen.tags
    assert evil in seen.text
    assert evil in seen.dimmed[0]
    assert "The design's text cannot be read by this program" in seen.text


def test_markers_that_are_not_taken_for_seen_are_listed_with_why():
    run = made.run()
    level = replace(made.level(run, "sphere", 3.9), left_out=(5,) + (0,) * 15)
    doubted = DoubtedPoint(4, 5, 35.0, 87.5, "3.9 psi", "it has jumped by 8.0 mm <b>")
    result = replace(made.result(run), levels=(level,), law=2, doubted=(doubted,))
    page = run_page([view_of(run, [made.trial(run, derived=result)])])
    assert "Markers that were there and are not taken for seen" in page
    assert "it has jumped by 8.0 mm &lt;b&gt;" in page
    assert "5 were far from their marker" in page


def test_a_run_without_any_trial_makes_a_page():
    run = made.run(note="", operator="", commit=None, simulated=False, simulated_heights=())
    seen = Seen(run_page([view_of(run, (), state="interrupted")]))

    assert "Sphere: no trial that counts yet" in seen.text
    assert "This run was interrupted; labctl run --continue 7 continues it." in seen.text
    assert "SIMULATED" not in seen.text
    # The sheet alone.
    assert len(seen.pictures) == 1


def test_a_run_in_which_nothing_could_be_measured_makes_a_page():
    run = made.run()
    blind = made.result(run, hidden=range(13))
    level = replace(
        blind.levels[0],
        **{name: None for name in ("mean_psi", "lowest_psi", "highest_psi", "e_t_percent")},
        **{name: (None,) * 16 for name in ("heights_mm", "height_sd_mm", "per_point_percent")},
        seen=(0,) * 16,
    )
    nothing = replace(
        blind, clock=None, frame_residual_mm=None, levels=(level,), problems=("3 of 16 markers seen",)
    )

    def unreadable(trial):
        raise LabError(f"{trial.raw['pressures'].path}: damaged")

    trials = [
        made.trial(run, 1, 1, outcome="failed", reason="3 of 16 markers seen", derived=nothing),
        made.trial(run, 1, 2, outcome="aborted", reason="stopped by the operator", derived=None, raw={}),
    ]
    seen = Seen(run_page([view_of(run, trials, state="failed", read=unreadable)]))

    assert "Sphere: no trial that counts after 2 attempts" in seen.text
    assert "3 of 16 markers seen" in seen.dimmed[0]
    assert "no, aborted: stopped by the operator" in seen.dimmed[1]
    assert "Trial 1: raw/0007-five-trial/trial-01-1.pressures.parquet: damaged." in seen.text
    assert "Trial 1, attempt 2: no pressure was recorded." in seen.text


def test_several_runs_stand_side_by_side_and_are_compared():
    first, other = made.run(number=7), made.run(number=8, simulated=False)
    views = [
        view_of(run, [made.trial(run, n + run.number) for n in (1, 2)], read=no_pressures)
        for run in (first, other)
    ]
    seen = Seen(run_page(views))

    assert "Runs 7 and 8" in seen.text
    assert "Some of these runs are of a SIMULATED RIG" in seen.text
    assert "run 7: sphere, neat, 3.90 psi" in seen.text
    assert "run 8: sphere, neat, 3.90 psi" in seen.text
    assert seen.tags.count("article") == 2


def test_what_has_no_like_is_said_once():
    """The sphere of run 7 has its like in run 8; neither has the cylinder of run 9."""
    runs = [made.run(number=7), made.run(number=8), made.run(number=9, patterns=("cylinder",))]
    views = [
        view_of(run, [made.trial(run, pattern=pattern)], read=no_pressures)
        for run, pattern in zip(runs, ("sphere", "sphere", "cylinder"), strict=True)
    ]

    assert len(comparison_table(views).rows) == 1
    assert format_unmatched(views) == "Not compared, having no like: run 9, neat, cylinder at 3.9 psi."
    assert format_unmatched(views[:2]) == ""


def no_pressures(trial):
    raise LabError("not of interest here")


def test_two_placements_make_the_published_table_and_its_comparison():
    placements = ("cylinder on sphere", "sphere on cylinder")
    run = made.run("layering", patterns=("cylinder", "sphere"), placements=placements)
    kinds = [
        (placement, pattern) for placement in placements for pattern in ("cylinder", "sphere") for _ in (1, 2)
    ]
    trials = [
        made.trial(run, number, placement=placement, pattern=pattern)
        for number, (placement, pattern) in enumerate(kinds, start=1)
    ]
    text = Seen(run_page([view_of(run, trials, read=no_pressures)])).text

    assert "fiber placement" in text
    assert "cylinder e_t" in text
    assert "Against each other" in text
    assert "cylinder, sphere on cylinder, 3.90 psi" in text


def test_no_run_and_no_place_are_refused(tmp_path):
    with pytest.raises(BadInput, match="no run to report"):
        write_run_page(tmp_path / "page.html", [])
    with pytest.raises(BadInput, match="there is no folder"):
        write_run_page(tmp_path / "nowhere" / "page.html", [view_of(made.run(), (), state="running")])
