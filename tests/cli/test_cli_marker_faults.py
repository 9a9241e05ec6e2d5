"""Whole inflations on doubles whose markers show what is not so."""

import json

import pytest


@pytest.fixture(scope="module")
def inflated():
    """The heights of an undisturbed inflation, filled in by the first test that needs them."""
    return {}


def inflate(lab, *words):
    return lab("inflate", "--rig", lab.rig, "--pattern", "sphere", *words)


@pytest.fixture
def undisturbed(inflated, lab_with):
    if not inflated:
        inflated["heights_mm"] = json.loads(inflate(lab_with(), "--json").out)["heights_mm"]
    return inflated["heights_mm"]


def off_mm(heights_mm, undisturbed):
    return max(abs(a - b) for a, b in zip(heights_mm, undisturbed, strict=True) if a is not None)


@pytest.mark.parametrize("percent", [1, 20])
def test_frames_at_the_origin_move_no_height(lab_with, undisturbed, percent):
    ended = inflate(lab_with(f"markers=outliers:{percent}%,3+5+9"), "--json")
    result = json.loads(ended.out)
    assert ended.code == 0
    assert None not in result["heights_mm"]
    assert off_mm(result["heights_mm"], undisturbed) < 0.05
    assert result["left_out_samples"][5] > 0
    assert result["left_out_samples"][4] == 0
    assert result["doubted"] == []


@pytest.mark.parametrize("when", ["", "@8", "@2psi"])
def test_markers_that_changed_places_are_not_measured_and_named(lab_with, undisturbed, when):
    ended = inflate(lab_with(f"markers=swapped:5+9{when}"), "--json")
    result = json.loads(ended.out)
    assert ended.code == 0
    assert [index for index, height in enumerate(result["heights_mm"]) if height is None] == [5, 9]
    assert off_mm(result["heights_mm"], undisturbed) < 0.05
    assert {each["marker"] for each in result["doubted"]} == {5, 9}


def test_a_person_reads_which_marker_and_why(lab_with):
    ended = inflate(lab_with("markers=outliers:100%,7"))
    assert ended.code == 0
    assert (
        "baseline: marker 7 (point 8, at 70, 52.5 mm) is not taken for seen: on the uninflated sheet"
        in ended.out
    )
    assert "length_unit" not in ended.out + ended.err
    assert "too rarely seen" not in ended.out


def test_too_many_are_a_failed_trial_with_the_reasons(lab_with):
    ended = inflate(lab_with("markers=scattered:60%,2+5+9+11+12"))
    assert ended.code == 1
    assert "11 of 16 markers have a height, and at least 12 are needed (measurement.min_points)" in ended.err
    assert "marker 2: its place scatters by" in ended.err
    assert "SAFE, as read back" in ended.err
