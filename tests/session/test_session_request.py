"""From options to a plan; every mistake is refused before anything moves."""

import json
from dataclasses import replace

import pytest

from labctl.config.load import load_design, rig_from_text
from labctl.doubles.rig_file import rig_toml
from labctl.doubles.settings import DoublesSettings
from labctl.errors import BadInput, LabError
from labctl.ledger.records import RunRequest
from labctl.plain_json import from_json, to_json
from labctl.session.catalogue import find_protocol, protocol_names
from labctl.session.dry_run import group_repeated
from labctl.session.request import RunOptions, complete, plan
from protocols.inflate import INFLATE

DESIGN = load_design("known")


def rig(**changes):
    text = rig_toml(DoublesSettings(design=DESIGN), "/dev/null", "/dev/zero", "127.0.0.1", 0)
    for before, after in changes.items():
        assert before in text
        text = text.replace(before, after)
    return rig_from_text(text, "rig.toml")


def planned(name, options, **changes):
    protocol = find_protocol(name)
    return plan(protocol, complete(protocol, options, DESIGN), DESIGN, rig(**changes))


def test_the_protocols_are_found_by_entry_point():
    assert set(protocol_names()) >= {
        "five-trial",
        "pressure-sweep",
        "relaxation",
        "layering",
        "calibration",
        "inflate",
    }


def test_an_unknown_protocol_is_answered_with_the_nearest():
    with pytest.raises(BadInput, match="five-trial"):
        find_protocol("five-trail")


def test_five_trials_read_like_the_laboratorys_checklist():
    trials = planned("five-trial", RunOptions(("sphere",)))

    assert [trial.number for trial in trials] == [1, 2, 3, 4, 5]
    assert [step.description.split(" (")[0] for step in trials[0].checklist.steps] == [
        "wait until the sheet has relaxed",
        "capture the uninflated sheet",
        "jam sphere",
        "ramp to 3.90 psi at 1 psi/s",
        "hold 3.90 +- 0.1 psi until pressure and shape have settled",
        "capture the sheet at 3.90 psi",
        "vent, unjam, and read SAFE back",
    ]
    assert all(step.deadline_s > step.lasts_s > 0 for step in trials[0].checklist.steps)


def test_inflate_is_one_trial_that_waits_for_no_stillness():
    (trial,) = plan(INFLATE, complete(INFLATE, RunOptions(("sphere",)), DESIGN), DESIGN, rig())

    assert trial.pressures_psi == (3.9,)
    assert [step.description.split(" (")[0] for step in trial.checklist.steps] == [
        "wait until less than 0.1 psi are left",
        "capture the uninflated sheet",
        "jam sphere",
        "ramp to 3.90 psi at 1 psi/s",
        "hold 3.90 +- 0.1 psi until the pressure has settled",
        "capture the sheet at 3.90 psi",
        "vent, unjam, and read SAFE back",
    ]
    assert all(step.deadline_s > step.lasts_s > 0 for step in trial.checklist.steps)


def test_inflate_is_not_repeated():
    with pytest.raises(BadInput, match="inflate does 1 trial of each kind, and --trials is 2"):
        complete(INFLATE, RunOptions(("sphere",), trials=2), DESIGN)


def test_a_sweep_goes_through_all_pressures_before_it_repeats_one():
    trials = planned("pressure-sweep", RunOptions(("sphere",), trials=2))

    assert [trial.pressures_psi for trial in trials] == [(2.6,), (3.0,), (3.5,), (3.9,)] * 2


def test_a_calibration_is_a_staircase_within_one_inflation():
    (trial,) = planned("calibration", RunOptions(("cylinder",), pressures_psi=(3.0, 2.0), trials=1))

    assert trial.pressures_psi == (2.0, 3.0)
    ramps = [step.description for step in trial.checklist.steps if step.description.startswith("ramp")]
    assert ramps == ["ramp to 2.00 psi at 1 psi/s", "ramp to 3.00 psi at 1 psi/s"]
    assert [step.lasts_s for step in trial.checklist.steps if step.description.startswith("ramp")] == [
        2.0,
        1.0,
    ]


def test_relaxation_vents_before_it_watches_and_vents_again_in_its_teardown():
    (trial,) = planned("relaxation", RunOptions(("sphere",), trials=1, watch_s=30.0))

    steps = [step.description for step in trial.checklist.steps]
    assert steps[-3:] == [
        "vent, unjam, and read SAFE back",
        "record the sheet for 30 s after venting",
        "vent, unjam, and read SAFE back",
    ]


def test_layering_measures_both_patterns_on_both_sheets_in_turn():
    trials = planned("layering", RunOptions(("cylinder", "sphere"), trials=2))

    assert [(trial.placement, trial.pattern) for trial in trials] == [
        ("cylinder on sphere", "cylinder"),
        ("cylinder on sphere", "sphere"),
    ] * 2 + [("sphere on cylinder", "cylinder"), ("sphere on cylinder", "sphere")] * 2
    assert trials[0].sheet != trials[-1].sheet


def test_a_request_comes_back_from_json_and_makes_the_same_plan():
    protocol = find_protocol("pressure-sweep")
    request = complete(protocol, RunOptions(("sphere",)), DESIGN)

    again = from_json(RunRequest, json.loads(json.dumps(to_json(request))))

    assert again == request
    assert group_repeated(plan(protocol, again, DESIGN, rig()))[0].numbers == (1, 5, 9, 13, 17)


@pytest.mark.parametrize(
    ("name", "options", "message"),
    [
        ("five-trial", RunOptions(()), "takes 1 --pattern, 0 given"),
        ("five-trial", RunOptions(("sphere", "cylinder")), "takes 1 --pattern, 2 given"),
        ("layering", RunOptions(("sphere",)), "takes 2 --pattern"),
        ("layering", RunOptions(("sphere", "sphere")), "named twice"),
        ("five-trial", RunOptions(("sphere",), pressures_psi=(3.0, 3.5)), "takes 1 --pressure"),
        ("five-trial", RunOptions(("spher",)), "unknown pattern 'spher'"),
        ("five-trial", RunOptions(("sphere",), watch_s=5.0), "leave --watch out"),
        ("relaxation", RunOptions(("sphere",), watch_s=1e9), "is above 21600 s"),
        ("relaxation", RunOptions(("sphere",), watch_s=1.0), "--watch 1 s is below 1.5 s"),
        ("layering", RunOptions(("sphere", "cylinder"), placement="neat"), "leave --placement out"),
        ("five-trial", RunOptions(("sphere",), pressures_psi=(4.2,)), "above the rig's limit of 4 psi"),
        ("pressure-sweep", RunOptions(("sphere",), pressures_psi=(3.0, 0.1)), "no inflation"),
    ],
)
def test_what_a_protocol_does_not_take_is_refused(name, options, message):
    with pytest.raises(BadInput, match=message):
        planned(name, options)


def test_a_fiber_without_a_valve_is_refused():
    design = load_design("known")
    assert max(design.channels("sphere")) <= 8
    with pytest.raises(BadInput, match="dump valve"):
        planned("five-trial", RunOptions(("sphere",)), **{"channels = 32": "channels = 32\ndump_channel = 2"})


@pytest.mark.parametrize("numbers", [(0, 1), (1, 1), (2, 1), (2, 3)])
def test_a_plan_that_does_not_count_its_trials_is_refused(numbers):
    """Of two trials of one number one would not count, and number 0 has no place in the ledger."""
    protocol = find_protocol("five-trial")

    def misnumbered(request, design, config):
        trials = protocol.plan(request, design, config)
        return tuple(replace(trial, number=number) for trial, number in zip(trials, numbers, strict=True))

    request = complete(protocol, RunOptions(("sphere",), trials=2), DESIGN)
    with pytest.raises(BadInput, match="does not number its 2 trials from 1"):
        plan(replace(protocol, plan=misnumbered), request, DESIGN, rig())


@pytest.mark.parametrize("placement", ["", " ", "one\ntwo", "\x1b[31mred"])
def test_a_placement_is_text_in_one_line(placement):
    with pytest.raises(BadInput, match=r"--placement .*: write a short name, in one line"):
        planned("five-trial", RunOptions(("sphere",), placement=placement))


@pytest.mark.parametrize("made", [lambda *_: {}["no such key"], lambda *_: None])
def test_a_protocol_that_makes_no_plan_is_named_with_the_place(made):
    protocol = replace(find_protocol("five-trial"), plan=made)

    with pytest.raises(LabError, match=r"protocol 'five-trial' made no plan: \w+Error.*\.py, line \d+"):
        plan(protocol, complete(protocol, RunOptions(("sphere",)), DESIGN), DESIGN, rig())


@pytest.mark.parametrize("missing", ["main", "teardown"])
def test_a_trial_without_steps_or_without_a_teardown_is_refused(missing):
    protocol = find_protocol("five-trial")

    def cut(request, design, config):
        (trial, *_) = protocol.plan(request, design, config)
        checklist = trial.checklist
        parts = {"main": replace(checklist, setup=(), main=()), "teardown": replace(checklist, teardown=())}
        return (replace(trial, checklist=parts[missing]),)

    request = complete(protocol, RunOptions(("sphere",), trials=1), DESIGN)
    with pytest.raises(BadInput, match="nothing to do or no teardown"):
        plan(replace(protocol, plan=cut), request, DESIGN, rig())
