"""A checklist is done in order until a step fails; its teardown always, every step of it."""

from types import SimpleNamespace

import pytest

from labctl.errors import BadInput, Stopped
from labctl.session.contract import Bench, Checklist, Step
from labctl.session.control_file import ControlFile, write_request
from labctl.session.perform import perform
from labctl.session.run_stop import RunStop, StepTooLong
from labctl.stop import OperatorStop


class HandClock:
    def __init__(self):
        self.now = 0.0

    def now_s(self):
        return self.now

    def sleep(self, seconds):
        self.now += seconds


@pytest.fixture
def lab():
    """A bench without a rig: only its clock is real, and it is moved by hand."""
    clock = HandClock()
    operator = OperatorStop()
    stop = RunStop(operator)
    return SimpleNamespace(
        clock=clock,
        operator=operator,
        stop=stop,
        done=[],
        bench=Bench(SimpleNamespace(clock=clock), lambda _: None, lambda _: None),
    )


def steps(lab, *names, failing=(), error=None):
    def deed(name):
        def do(bench):
            lab.done.append(name)
            if name in failing:
                raise error or RuntimeError(name)

        return do

    return tuple(Step(name, 1.0, 10.0, deed(name)) for name in names)


def checklist(lab, **failing):
    return Checklist(
        steps(lab, "relax", "baseline", **failing),
        steps(lab, "jam", "ramp", **failing),
        steps(lab, "vent", "unjam", **failing),
    )


def test_all_steps_are_done_in_order(lab):
    performed = perform(checklist(lab), lab.bench, lab.stop)

    assert lab.done == ["relax", "baseline", "jam", "ramp", "vent", "unjam"]
    assert performed.first_error is None


@pytest.mark.parametrize("error", [RuntimeError("x"), KeyboardInterrupt(), SystemExit(1), Stopped("x")])
def test_after_an_error_only_the_teardown_is_done_and_all_of_it(lab, error):
    performed = perform(checklist(lab, failing=("baseline",), error=error), lab.bench, lab.stop)

    assert lab.done == ["relax", "baseline", "vent", "unjam"]
    assert performed.error is error
    assert performed.step.description == "baseline"


@pytest.mark.parametrize("error", [RuntimeError("x"), KeyboardInterrupt()])
def test_a_teardown_step_that_fails_keeps_no_other_from_being_done(lab, error):
    performed = perform(checklist(lab, failing=("vent",), error=error), lab.bench, lab.stop)

    assert lab.done[-2:] == ["vent", "unjam"]
    assert performed.first_error is error


def test_a_stop_is_seen_before_the_next_step_and_not_by_the_teardown(lab):
    def on_step(step):
        if step.description == "jam":
            lab.operator.set("Ctrl-C")

    performed = perform(checklist(lab), lab.bench, lab.stop, on_step)

    assert lab.done == ["relax", "baseline", "jam", "vent", "unjam"]
    assert isinstance(performed.error, Stopped)


def test_a_step_that_waits_by_the_rig_is_ended_at_its_deadline(lab):
    def wait_for_ever(_bench):
        while True:
            lab.clock.sleep(1.0)
            lab.stop.check()

    slow = Checklist((Step("relax", 1.0, 10.0, wait_for_ever),), (), steps(lab, "vent"))

    performed = perform(slow, lab.bench, lab.stop)

    assert isinstance(performed.error, StepTooLong)
    assert "relax" in str(performed.error)
    assert lab.clock.now == pytest.approx(11.0)
    assert lab.done == ["vent"]


def test_a_teardown_step_has_its_deadline_even_while_a_stop_is_requested(lab):
    def wait_for_ever(_bench):
        while True:
            lab.clock.sleep(1.0)
            lab.stop.check()

    lab.operator.set("Ctrl-C")
    slow = Checklist(steps(lab, "relax"), (), (Step("vent", 1.0, 10.0, wait_for_ever),))

    performed = perform(slow, lab.bench, lab.stop)

    assert isinstance(performed.error, Stopped)
    assert isinstance(performed.teardown_errors[0], StepTooLong)


def test_an_abort_from_another_terminal_is_a_stop(lab, tmp_path):
    control_file = ControlFile(tmp_path, lab.clock)
    lab.stop.watch(control_file)
    lab.stop.check()

    write_request(tmp_path, "abort")
    lab.clock.sleep(0.3)

    with pytest.raises(Stopped, match="labctl abort"):
        lab.stop.check()


def test_a_request_to_an_earlier_run_is_not_for_this_one(lab, tmp_path):
    write_request(tmp_path, "pause")

    assert not ControlFile(tmp_path, lab.clock).pause_requested()


def test_a_pause_lasts_until_the_request_changes(lab, tmp_path):
    control_file = ControlFile(tmp_path, lab.clock)
    for request, paused in (("pause", True), ("resume", False), ("pause", True)):
        write_request(tmp_path, request)
        lab.clock.sleep(0.3)
        assert control_file.pause_requested() is paused


@pytest.mark.parametrize("request_after", ["pause", "resume"])
def test_no_request_takes_the_place_of_an_abort(lab, tmp_path, request_after):
    """A run that is recording a trial does not look for seconds."""
    control_file = ControlFile(tmp_path, lab.clock)
    write_request(tmp_path, "abort")
    with pytest.raises(BadInput, match="is being aborted already"):
        write_request(tmp_path, request_after)
    assert control_file.abort_requested()
    control_file.clear()
    write_request(tmp_path, request_after)


@pytest.mark.parametrize("text", ["", "{", "[]", '{"word": 3}', "\x00"])
def test_a_damaged_request_means_nothing(lab, tmp_path, text):
    control_file = ControlFile(tmp_path, lab.clock)
    (tmp_path / "wish.json").write_text(text)
    lab.clock.sleep(0.3)

    assert not control_file.pause_requested()
    assert not control_file.abort_requested()
