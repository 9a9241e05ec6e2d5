import json

from labctl.doubles.trace import Trace


def test_each_line_is_in_the_file_as_soon_as_it_is_written(plant_of, clock, tmp_path):
    path = tmp_path / "trace.jsonl"
    plant = plant_of()
    trace = Trace(path, clock)
    plant.write_coils({20: True, 1: True})
    plant.write_setpoint(2.0)
    clock.sleep(0.1)
    trace.write(plant.state())
    row = json.loads(path.read_text())
    trace.close()
    trace.write(plant.state())
    assert len(path.read_text().splitlines()) == 1
    assert row["coils"] == [1, 20]
    assert row["jammed"] == ["left", "under"]
    assert (row["time_s"], row["wall_s"]) == (0.1, clock.now_s())
    assert (row["setpoint_psi"], row["exhausting"]) == (2.0, False)
    assert 0 < row["pressure_psi"] < 0.2
