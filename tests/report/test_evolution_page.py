import base64
import re
from dataclasses import replace
from html.parser import HTMLParser

import made_run
import pytest

from labctl.design_search.pick import all_picks
from labctl.errors import BadInput
from labctl.report.search.page import evolution_page, write_evolution_page
from labctl.report.search.text import duration, searched_for


class Seen(HTMLParser):
    """What a page shows: pictures, table cells, and all its text."""

    def __init__(self, page):
        super().__init__()
        self.pictures, self.tags, self.text = [], [], ""
        self.feed(page)

    def handle_starttag(self, tag, attributes):
        self.tags.append(tag)
        if tag == "img":
            self.pictures.append(dict(attributes))

    def handle_data(self, data):
        self.text += data


def page_of(*runs):
    return evolution_page(runs, all_picks(runs))


def test_a_page_holds_everything_in_itself(tmp_path):
    runs = [made_run.run((0.0, 10.0), (0.1, 6.0), (1.0, 0.0), notes={"versions": {"labctl": "7.8.9"}})]
    write_evolution_page(tmp_path / "index.html", runs, all_picks(runs))
    page = (tmp_path / "index.html").read_text(encoding="utf-8")
    seen = Seen(page)

    # Progress, front, and for each of two picks: fibers and shapes of two patterns.
    assert len(seen.pictures) == 2 + 2 * (2 + 2)
    for picture in seen.pictures:
        kind, content = picture["src"].split(",")
        assert kind == "data:image/svg+xml;base64"
        assert b"<svg" in base64.b64decode(content)
        assert picture["alt"]
    assert not {"script", "link", "iframe"} & set(seen.tags)
    assert not re.search(r"https?://", page)
    for words in (
        "1.000",
        "6.000",
        "labctl 7.8.9",
        "Picked design (knee)",
        "1 min 10 s",
        "25, 35",
        "115, 50",
    ):
        assert words in seen.text.replace("\u00a0", " ")
    assert page == page_of(*runs)
    assert [entry.name for entry in tmp_path.iterdir()] == ["index.html"]


def test_what_a_person_wrote_is_shown_as_written():
    name = "<b>bold</b> & $x_{1}$ {{ 7*7 }} " + "long" * 30
    seen = Seen(page_of(made_run.run((1.0,), names=(name,), notes={"sheet": "<script>alert(1)</script>"})))

    assert name in seen.text
    assert "<script>alert(1)</script>" in seen.text
    assert "script" not in seen.tags
    assert any(name in picture["alt"] for picture in seen.pictures)


def test_seeds_of_one_search_share_a_page():
    runs = [made_run.run((1.0, 4.0)), made_run.run((0.9, 2.0), seed=2)]
    seen = Seen(page_of(*runs))

    assert "On the joint front" in seen.text
    # One design is picked by both rules.
    assert len(seen.pictures) == 2 + (2 + 2)
    # Both seeds' seconds and sheets.
    assert "2\u00a0min\u00a020\u00a0s" in seen.text
    assert "28" in seen.text


def test_a_run_that_this_program_does_not_reproduce_is_reported():
    seen = Seen(page_of(made_run.run((1.0,), names=("saddle",))))

    assert "but the run found 1.000 mm" in seen.text


def test_runs_of_different_searches_have_no_page(tmp_path):
    runs = [made_run.run((1.0, 4.0)), made_run.run((2.0, 2.0), seed=2, names=("saddle", "other"))]

    with pytest.raises(BadInput, match="not seeds of one search"):
        write_evolution_page(tmp_path / "index.html", runs, all_picks(runs))
    assert not list(tmp_path.iterdir())


def test_the_head_says_what_is_out_of_the_ordinary():
    run = made_run.run((1.0, 4.0))
    constraints = replace(run.settings.constraints, representation="exclusive", valves=16)
    facts = dict(searched_for([replace(run, settings=replace(run.settings, constraints=constraints))]))

    assert facts["representation"] == "exclusive: each fiber is jammed for one target"
    assert "16 valves" in facts["constraints"]
    assert facts["target 2"] == "monkey (equation)"


@pytest.mark.parametrize(
    ("seconds", "shown"), [(42.6, "43 s"), (59.7, "1 min 0 s"), (725, "12 min 5 s"), (11_220, "3 h 7 min")]
)
def test_durations_are_for_people(seconds, shown):
    assert duration(seconds).replace("\u00a0", " ") == shown
