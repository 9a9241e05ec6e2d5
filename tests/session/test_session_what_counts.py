"""What is recorded as good is good: after a stop, a trip, or a rig that nobody vented, nothing counts."""

from dataclasses import replace
from types import SimpleNamespace

import pytest

from labctl.errors import Stopped, Tripped
from labctl.ledger.ledger import Ledger
from labctl.session.contract import Step
from labctl.session.engine import RunFailed


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


def do(description, deed):
    return Step(description, 0.1, 10.0, deed)


def test_a_trial_that_nobody_vents_does_not_count_and_the_rig_is_vented_at_once(laboratory):
    """SAFE was read back before the first trial: that is not SAFE after it."""
    lab = laboratory()
    found = []
    lab.committed = SimpleNamespace(append=lambda record: (lab.assert_safe(), found.append(record)))

    with pytest.raises(RunFailed):
        lab.run(lab.prepared(attempts=1), change=lambda trials: with_steps(trials, teardown=lambda _: ()))

    (record,) = found
    assert record.outcome == "failed"
    assert record.reason == "the teardown left the rig energised: put vent_and_unjam into it"
    assert record.safe.safe is True
    assert kinds(lab) == ["trial-begun", "failed"]


def test_a_trip_that_no_step_saw_is_no_good_trial(laboratory):
    """The last step is over when the supervisor trips; the teardown looks at no latch."""
    lab = laboratory()

    def trip(bench):
        bench.rig._supervisor.trip_reason = "the regulator reports ADC"

    with pytest.raises(Tripped, match="ADC"):
        lab.run(change=lambda trials: with_steps(trials, main=lambda main: (*main, do("trip", trip))))

    (record,) = lab.committed
    assert record.outcome == "failed"
    assert "the regulator reports ADC" in record.reason
    assert kinds(lab) == ["trial-begun", "interrupted"]


def test_a_stop_during_the_teardown_is_no_good_trial(laboratory):
    lab = laboratory()
    stop = do("stop", lambda _: lab.operator.set("Ctrl-C"))

    with pytest.raises(Stopped):
        lab.run(change=lambda trials: with_steps(trials, teardown=lambda teardown: (*teardown, stop)))

    (record,) = lab.committed
    assert record.outcome == "aborted"
    assert record.safe.safe is True


def test_a_planned_pressure_that_was_never_captured_is_no_good_trial(laboratory):
    lab = laboratory()

    with pytest.raises(RunFailed, match=r"no window was captured at 1\.5 psi"):
        lab.run(
            lab.prepared(trials=1, attempts=1),
            change=lambda trials: with_steps(trials, main=lambda steps: steps[:-1]),
        )

    assert [record.outcome for record in lab.committed] == ["failed"]
    lab.assert_safe()
