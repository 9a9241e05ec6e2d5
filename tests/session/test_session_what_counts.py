"""What is recorded as good is good: after a stop, a trip, or a rig that nobody vented, nothing counts."""

from dataclasses import replace

import pytest

from labctl.errors import Stopped, Tripped, Unsafe
from labctl.ledger.ledger import Ledger
from labctl.session.contract import Step


def kinds(lab):
    with Ledger.open(lab.folder, lambda _: None) as ledger:
        return [event.kind for event in ledger.events(1)]


def with_steps(trials, **parts):
    """The plan with other steps in `main` or `teardown`; each part is a function of the steps that were there."""
    return tuple(
        replace(
            trial,
            checklist=replace(
                trial.checklist,
                **{part: change(getattr(trial.checklist, part)) for part, change in parts.items()},
            ),
        )
        for trial in trials
    )


def do(words, deed):
    return Step(words, 0.1, 10.0, deed)


def test_a_trial_that_nobody_vents_does_not_count_and_ends_the_run(laboratory):
    """SAFE was read back before the first trial: that is not SAFE after it."""
    lab = laboratory()

    with pytest.raises(Unsafe):
        lab.run(change=lambda trials: with_steps(trials, teardown=lambda _: ()))

    lab.assert_safe()
    (record,) = lab.told
    assert record.outcome == "failed"
    assert record.reason == "SAFE was not read back after the trial"
    assert record.safe["safe"] is False
    assert kinds(lab) == ["trial-begun", "interrupted"]


def test_a_trip_that_no_step_saw_is_no_good_trial(laboratory):
    """The last step is over when the supervisor trips; the teardown looks at no latch."""
    lab = laboratory()

    def trip(bench):
        bench.rig._supervisor.trip_reason = "the regulator reports ADC"

    with pytest.raises(Tripped, match="ADC"):
        lab.run(change=lambda trials: with_steps(trials, main=lambda main: (*main, do("trip", trip))))

    (record,) = lab.told
    assert record.outcome == "failed"
    assert "the regulator reports ADC" in record.reason
    assert kinds(lab) == ["trial-begun", "interrupted"]


def test_a_stop_during_the_teardown_is_no_good_trial(laboratory):
    lab = laboratory()
    stop = do("stop", lambda _: lab.operator.set("Ctrl-C"))

    with pytest.raises(Stopped):
        lab.run(change=lambda trials: with_steps(trials, teardown=lambda teardown: (*teardown, stop)))

    (record,) = lab.told
    assert record.outcome == "aborted"
    assert record.safe["safe"] is True
