"""Doing a checklist: setup and main until one fails, then the whole teardown, each step within its deadline."""

import logging
from collections.abc import Callable
from dataclasses import dataclass

from labctl.session.contract import Bench, Checklist, Step
from labctl.session.run_stop import RunStop

_LOG = logging.getLogger("labctl.session")


@dataclass(frozen=True)
class PerformedChecklist:
    """How a checklist ended: the error that ended it, and those of the teardown; none where all was done."""

    step: Step
    error: BaseException | None
    teardown_errors: tuple[BaseException, ...]

    @property
    def first_error(self) -> BaseException | None:
        """The error that counts."""
        return self.error or (self.teardown_errors[0] if self.teardown_errors else None)


def perform(
    checklist: Checklist, bench: Bench, stop: RunStop, on_step: Callable[[Step], None] = lambda _: None
) -> PerformedChecklist:
    """Do a checklist; raises nothing. `on_step` gets each step before it is done.

    What is no `Exception` (an interrupt out of nowhere, an exit) ends setup and main like any error and is
    returned, so that teardown and the record of the trial come first.
    """
    done = checklist.steps[0]
    error: BaseException | None = None
    try:
        for step in (*checklist.setup, *checklist.main):
            done = step
            _do(step, bench, stop, on_step, teardown=False)
    except BaseException as caught:
        error = caught
    failed_teardown: list[BaseException] = []
    for step in checklist.teardown:
        try:
            _do(step, bench, stop, on_step, teardown=True)
        # The next step of a teardown is done whatever became of this one.
        except BaseException as caught:
            failed_teardown.append(caught)
    return PerformedChecklist(done, error, tuple(failed_teardown))


def _do(step: Step, bench: Bench, stop: RunStop, on_step: Callable[[Step], None], *, teardown: bool) -> None:
    if not teardown:
        stop.check()
    with stop.during(step.description, step.deadline_s, bench.rig.clock, teardown=teardown):
        on_step(step)
        start_s = bench.rig.clock.now_s()
        _LOG.info("begin: %s", step.description)
        try:
            step.do(bench)
        except BaseException as error:
            _LOG.info(
                "failed after %.2f s: %s: %r", bench.rig.clock.now_s() - start_s, step.description, error
            )
            raise
        _LOG.info("done in %.2f s: %s", bench.rig.clock.now_s() - start_s, step.description)
