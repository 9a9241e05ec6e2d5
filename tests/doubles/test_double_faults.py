import numpy as np
import pytest

from labctl.doubles.faults import Fault, FaultPanel, Faults, parse_faults
from labctl.doubles.line_faults import LineFaults
from labctl.errors import BadInput


def test_words_become_faults_of_their_instrument():
    words = ["regulator=garbage", "valves=late:0.8", "valves=stuck-coil:7", "markers=silent@12"]
    assert parse_faults(words) == Faults(
        regulator=(Fault("garbage"),),
        valves=(Fault("late", 0.8), Fault("stuck-coil", 7.0)),
        markers=(Fault("silent", from_s=12.0),),
    )
    assert parse_faults(["valves=silent@3.5psi"]).valves == (Fault("silent", from_psi=3.5),)
    assert parse_faults(["regulator=dies-after:3@1.5"]).regulator == (Fault("dies-after", 3.0, 1.5),)


def test_a_gauge_may_be_off_in_either_direction():
    words = ["regulator=offset:-0.3@3psi", "regulator=drift:0.02", "gauge=gain:1.1"]
    assert parse_faults(words) == Faults(
        regulator=(Fault("offset", -0.3, from_psi=3.0), Fault("drift", 0.02)), gauge=(Fault("gain", 1.1),)
    )


def test_faults_of_markers_may_name_them():
    words = [
        "outliers:5%",
        "outliers:1,3",
        "scattered:20%,3+7+9@2.5psi",
        "swapped:5+9",
        "swapped:5+9+2,1.5@12",
    ]
    assert parse_faults([f"markers={word}" for word in words]).markers == (
        Fault("outliers", 5.0),
        Fault("outliers", 1.0, ids=(3,)),
        Fault("scattered", 20.0, from_psi=2.5, ids=(3, 7, 9)),
        Fault("swapped", ids=(5, 9)),
        Fault("swapped", 1.5, from_s=12.0, ids=(5, 9, 2)),
    )


@pytest.mark.parametrize(
    ("word", "message"),
    [
        ("garbage", "is not INSTRUMENT=KIND; allowed: regulator= silent, garbage"),
        ("pump=silent", "is not INSTRUMENT=KIND"),
        ("valves=stuck-exhaust", "valves has no fault 'stuck-exhaust'; allowed: .*valves= .*stuck-coils"),
        ("markers=late", "write markers=late:SECONDS"),
        ("markers=silent:3", "it takes no value"),
        ("regulator=drifting-sensor", "write regulator=drifting-sensor:PSI-PER-SECOND"),
        ("regulator=drifting-sensor:-1", "psi-per-second is '-1'; it must be a number of at least 0"),
        ("markers=frozen-answer", "markers has no fault 'frozen-answer'"),
        ("markers=late:soon", "seconds is 'soon'; it must be a number of at least 0"),
        ("markers=late:-1", "at least 0"),
        ("markers=late:nan", "seconds is 'nan'"),
        ("regulator=dies-after:2.5", "count is '2.5'; it must be a whole number"),
        ("valves=stuck-coil:0", "at least 1"),
        ("regulator=offset:much", "offset is 'much'; it must be a number$"),
        ("regulator=gain:-1", "factor is '-1'; it must be a number of at least 0.1"),
        ("valves=offset:0.1", "valves has no fault 'offset'"),
        ("valves=silent@later", "seconds is 'later'"),
        ("valves=silent@highpsi", "psi is 'high'"),
        ("markers=outliers:101%", "at least 0 and at most 100"),
        ("markers=outliers:5%,three", "are no marker ids; write them as 3\\+7"),
        ("markers=outliers:5%,3+3", "each once"),
        ("markers=swapped:5", "two markers or more, as in markers=swapped:3\\+7"),
        ("markers=swapped:5+9,soon", "seconds is 'soon'"),
        ("markers=mirrored:-3", "mm is '-3'; it must be a number of at least 0"),
        ("markers=ghosts:1.5", "count is '1.5'"),
    ],
)
def test_other_words_are_refused_with_what_is_allowed(word, message):
    with pytest.raises(BadInput, match=message):
        parse_faults([word])


@pytest.fixture
def line(clock):
    def make(*words):
        faults = parse_faults([f"regulator={word}" for word in words]).regulator
        return LineFaults(FaultPanel(clock, faults), clock, np.random.default_rng(0))

    return make


def test_replies_pass_untouched_without_faults(line, clock):
    delivery = line().deliver(b"A +003.90\r", b"B +003.90\r")
    assert (delivery.data, delivery.due_s) == (b"A +003.90\r", clock.now_s())


@pytest.mark.parametrize(
    ("word", "sent"),
    [("silent", b""), ("truncated", b"A +00"), ("wrong-address", b"B +003.90\r")],
)
def test_what_a_fault_makes_of_a_reply(line, word, sent):
    assert line(word).deliver(b"A +003.90\r", b"B +003.90\r").data == sent


def test_garbage_is_as_long_as_the_reply_and_replays_with_its_seed(line):
    first = line("garbage").deliver(b"A +003.90\r").data
    assert len(first) == 10
    assert first != b"A +003.90\r"
    assert line("garbage").deliver(b"A +003.90\r").data == first


def test_late_reply_is_due_later(line, clock):
    assert line("late:0.8").deliver(b"A\r").due_s == pytest.approx(clock.now_s() + 0.8)


def test_dies_after_so_many_requests(line):
    faults = line("dies-after:2")
    assert [faults.deliver(b"x").data for _ in range(3)] == [b"x", b"x", b""]
    assert faults.dead


def test_fault_begins_at_its_time_and_can_be_switched(clock):
    panel = FaultPanel(clock, (Fault("silent", from_s=12.0),))
    clock.sleep(11.9)
    assert panel.active("silent") is None
    clock.sleep(0.2)
    assert panel.active("silent") == Fault("silent", from_s=12.0)
    panel.switch(())
    assert panel.active("silent") is None


def test_all_faults_of_a_kind_that_have_begun(clock):
    faults = (Fault("outliers", 1.0), Fault("outliers", 2.0, from_s=5.0), Fault("blind"))
    panel = FaultPanel(clock, faults)
    assert panel.all_active("outliers") == faults[:1]
    clock.sleep(5.0)
    assert panel.all_active("outliers") == faults[:2]


def test_fault_begins_once_the_pressure_has_been_reached_and_stays(clock):
    panel = FaultPanel(clock, (Fault("silent", from_psi=3.0),))
    highest_psi = 2.9
    panel.follow(lambda: highest_psi)
    assert panel.active("silent") is None
    highest_psi = 3.0
    assert panel.active("silent") is not None


def test_a_frozen_answer_is_the_last_one_whatever_is_asked(line):
    faults = line("frozen-answer@1psi")
    highest_psi = [0.0]
    faults.panel.follow(lambda: highest_psi[0])
    assert faults.deliver(b"first").data == b"first"
    assert faults.deliver(b"second").data == b"second"
    highest_psi[0] = 1.0
    assert faults.deliver(b"third").data == b"second"
    assert faults.deliver(b"fourth").data == b"second"
