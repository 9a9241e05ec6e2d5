"""A run is continued only on a rig that measures as the one it was started on."""

from dataclasses import asdict, replace
from types import SimpleNamespace

import pytest
from made_ledger import a_run

from labctl.config.load import load_design, rig_from_text
from labctl.doubles.rig_file import rig_toml
from labctl.doubles.settings import DoublesSettings
from labctl.errors import BadInput
from labctl.session.continuation import changed_instruments, require_same_rig

CONFIG = rig_from_text(
    rig_toml(DoublesSettings(design=load_design("known")), "/dev/null", "/dev/zero", "127.0.0.1", 0),
    "rig.toml",
)


def refusal(**markers):
    changed = replace(CONFIG, markers=replace(CONFIG.markers, **markers))
    with pytest.raises(BadInput) as refused:
        require_same_rig(a_run(rig=asdict(CONFIG)), changed)
    return str(refused.value)


def test_the_same_rig_at_another_address_is_the_same():
    require_same_rig(a_run(rig=asdict(CONFIG)), replace(CONFIG, speed=3.0, source="moved.toml"))


def test_a_rig_recorded_before_there_were_limits_of_what_is_left_out_had_the_defaults():
    before = asdict(CONFIG)
    for key in ("max_left_out", "max_left_out_of_all"):
        del before["measurement"][key]
    require_same_rig(a_run(rig=before), CONFIG)
    stricter = replace(CONFIG, measurement=replace(CONFIG.measurement, max_left_out=0.1))
    with pytest.raises(BadInput, match=r"measurement\.max_left_out was 0\.25 and is 0\.1"):
        require_same_rig(a_run(rig=before), stricter)


def test_a_rig_recorded_before_a_key_was_there_had_its_default():
    before = asdict(CONFIG)
    for key in ("rest_within_psi", "still_after_s", "sheet_response_s", "unseen_after_s", "max_lateness_s"):
        del before["limits"][key]
    for key in ("pressure_unit_proven", "word_order"):
        del before["regulator"][key]
    require_same_rig(a_run(rig=before), CONFIG)
    otherwise = replace(CONFIG, regulator=replace(CONFIG.regulator, word_order="low-first"))
    with pytest.raises(BadInput, match=r"regulator\.word_order was high-first and is low-first"):
        require_same_rig(a_run(rig=before), otherwise)


def test_what_guards_a_rig_may_be_set_otherwise():
    limits = replace(CONFIG.limits, still_after_s=0.5, sheet_response_s=3.0)
    require_same_rig(a_run(rig=asdict(CONFIG)), replace(CONFIG, limits=limits))


def test_of_many_points_the_one_that_moved_is_named():
    points = list(CONFIG.markers.points)
    points[3] = replace(points[3], x_mm=36.0)

    message = refusal(points=tuple(points))

    assert "markers.points.03.x_mm was 35.0 and is 36.0" in message
    assert "points.02" not in message


def test_a_point_that_is_gone_is_named():
    message = refusal(points=CONFIG.markers.points[:-1])

    assert "markers.points.15 was {'id': 15" in message
    assert "and is nothing" in message


def test_of_very_many_differences_the_first_are_named():
    points = tuple(replace(point, x_mm=point.x_mm + 1) for point in CONFIG.markers.points)

    message = refusal(points=points)

    assert "markers.points.05.x_mm" in message
    assert "markers.points.06.x_mm" not in message
    assert "; and 10 more. Set it back in" in message


def test_an_instrument_that_was_exchanged_is_reported_and_one_that_was_not_is_not():
    run = a_run(rig=asdict(CONFIG))
    before = run.identities["regulator"]
    identities = {**run.identities, "regulator": replace(before, serial_number="112233")}
    rig = SimpleNamespace(identities=SimpleNamespace(by_instrument=lambda: identities))

    assert changed_instruments(run, rig) == (
        f"regulator: the run was started with {before.model}, serial number not reported, firmware not reported; "
        f"{before.model}, serial number 112233, firmware not reported answers now",
    )
