import math
import tomllib

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from labctl.config.checks_rig import rig_problems
from labctl.config.errors import ConfigError
from labctl.config.load import load_rig
from labctl.config.rig import Limits, MarkerPoint
from labctl.config.schema_rig import RigFile
from labctl.config.source import Document
from labctl.config.validate import validate


def mistake(path):
    """The one mistake of a file."""
    with pytest.raises(ConfigError) as caught:
        load_rig(path)
    (problem,) = caught.value.problems
    assert str(caught.value) == str(problem)
    return problem


def test_every_key_arrives_in_its_field_and_unit(rig_file):
    rig = load_rig(rig_file())

    assert (rig.name, rig.simulated, rig.speed) == ("bench A", False, 1.0)
    assert rig.source.endswith("rig.toml")
    regulator, valves, markers = rig.regulator, rig.valves, rig.markers
    assert (regulator.driver, regulator.model, regulator.port) == ("alicat-ascii", "PCD", "/dev/ttyUSB0")
    assert (regulator.baudrate, regulator.unit_id, regulator.device_id) == (19200, "A", 1)
    assert (regulator.name, regulator.pressure_unit, regulator.timeout_s) == ("regulator A", "psi", 0.5)
    assert (valves.transport, valves.port, valves.baudrate) == ("rtu", "/dev/ttyUSB1", 9600)
    assert (valves.channels, valves.dump_channel, valves.timeout_s) == (32, 32, 0.5)
    assert (markers.host, markers.server_number, markers.frequency_hz) == ("192.168.1.230", 0, 240.0)
    assert (markers.up, markers.length_unit_mm) == ("+z", 1.0)
    assert markers.points == (
        MarkerPoint(0, 17.5, 52.5),
        MarkerPoint(1, 35.0, 17.5),
        MarkerPoint(2, 105.0, 87.5),
        MarkerPoint(7, 70.0, 122.5),
    )
    assert rig.limits == Limits(settle_s=3.0), (
        "the file says what the defaults are, but for the settling time"
    )


def test_every_limit_is_read_from_its_own_key(rig_file):
    text = rig_file().read_text()
    head, _ = text.split("[limits]")
    values = {
        "max_pressure": 5.0,
        "warn_pressure": 5.5,
        "trip_pressure": 6.0,
        "safe_pressure": 0.25,
        "min_pressure": -0.75,
        "hold_tolerance": 0.2,
        "ramp": 0.75,
        "settle": 4.0,
        "settle_timeout": 40.0,
        "capture": 2.0,
        "stale_after": 1.25,
        "heartbeat": 0.9,
        "vent_timeout": 15.0,
        "follow_within": 1.5,
        "follow_timeout": 6.0,
        "rest_within": 0.05,
        "still_after": 1.5,
        "sheet_response": 4.0,
        "sheet_creep": 0.1,
        "unseen_after": 1.75,
        "tare_within": 0.4,
        "gauge_agreement": 0.3,
        "warn_lateness": 0.03,
        "max_lateness": 0.3,
    }
    path = rig_file()
    path.write_text(head + "[limits]\n" + "\n".join(f"{key} = {value}" for key, value in values.items()))
    assert load_rig(path).limits == Limits(*values.values())


def test_keys_with_a_default_may_be_left_out(rig_file):
    path = rig_file(
        ('name = "regulator A"\n', ""),
        ("baudrate = 19200\n", ""),
        ("baudrate = 9600\n", ""),
        ("dump_channel = 32\n", ""),
        ('length_unit = "1 mm"\n', ""),
    )
    text = path.read_text()
    path.write_text(text[: text.index("[limits]")])
    rig = load_rig(path)
    assert (rig.regulator.name, rig.regulator.baudrate, rig.valves.baudrate) == ("regulator", 19200, 9600)
    assert rig.valves.dump_channel is None
    assert rig.markers.length_unit_mm == 1.0
    assert rig.limits == Limits()


def test_points_may_be_an_array_of_tables(rig_file):
    path = rig_file()
    text = path.read_text()
    inline = text[text.index("points = [") : text.index("[limits]")]
    tables = "".join(
        f'[[markers.points]]\nid = {n}\nx = "{x} mm"\ny = "{y} mm"\n'
        for n, x, y in [(3, 1, 2), (4, 50, 2), (5, 9, 90)]
    )
    path.write_text(text.replace(inline, tables + '[[markers.points]]\nid = 3\nx = "70 mm"\ny = "12 in"\n\n'))
    with pytest.raises(ConfigError) as caught:
        load_rig(path)
    problems = {problem.key: problem for problem in caught.value.problems}
    assert set(problems) == {"markers.points[id 3].id", "markers.points[id 3].y"}
    lines = path.read_text().splitlines()
    assert lines[problems["markers.points[id 3].y"].line - 1] == 'y = "12 in"'
    assert "is the id of point #1 too" in problems["markers.points[id 3].id"].message


def test_a_simulated_rig_may_be_fast_and_without_addresses(rig_file):
    path = rig_file(
        ("simulated = false", "simulated = true"),
        ("speed = 1.0", "speed = 20"),
        ('port = "/dev/ttyUSB0"\n', ""),
        ('port = "/dev/ttyUSB1"\n', ""),
        ('host = "192.168.1.230"\n', ""),
    )
    rig = load_rig(path)
    assert (rig.simulated, rig.speed, rig.regulator.port, rig.markers.host) == (True, 20.0, "", "")


MAX = 'max_pressure = "4.0 psi"'
# Each row: what to replace, by what, the line's beginning, and what the message says.
MISTAKES = [
    # text
    ('name = "bench A"', 'name = ""', "name", "text that is not empty"),
    ('name = "bench A"', 'name = "two\\nlines"', "name", "on one line"),
    ('unit_id = "A"', 'unit_id = "a"', "regulator.unit_id", "one letter from A to Z"),
    ('unit_id = "A"', 'unit_id = "Ä"', "regulator.unit_id", "one letter from A to Z"),
    ('host = "192.168.1.230"', 'host = "the rig"', "markers.host", "host name or address"),
    # choices
    ('driver = "alicat-ascii"', 'driver = "alicat"', "regulator.driver", '"alicat-ascii" or "alicat-modbus"'),
    ('up = "+z"', 'up = "z"', "markers.up", '"+z" or "-z"'),
    ('pressure_unit = "psi"', 'pressure_unit = "Pa"', "regulator.pressure_unit", '"psi", "kPa", "bar"'),
    ("channels = 32\nd", "channels = 20\nd", "valves.channels", "8, 16 or 32"),
    ("baudrate = 19200", "baudrate = 1920", "regulator.baudrate", "9600"),
    ("baudrate = 19200", 'baudrate = "19200"', "regulator.baudrate", "19200"),
    # numbers
    ("simulated = false", "simulated = 0", "simulated", "true or false"),
    ("device_id = 1\np", "device_id = true\np", "regulator.device_id", "whole number from 1 to 247"),
    ("device_id = 1\np", "device_id = 248\np", "regulator.device_id", "whole number from 1 to 247"),
    ("device_id = 1\np", "device_id = 1.0\np", "regulator.device_id", "whole number from 1 to 247"),
    ("server_number = 0", "server_number = -1", "markers.server_number", "from 0 to"),
    ("frequency_hz = 240", "frequency_hz = 961", "markers.frequency_hz", "from 10 to 960 Hz"),
    ("frequency_hz = 240", "frequency_hz = 0", "markers.frequency_hz", "from 10 to 960 Hz"),
    ("frequency_hz = 240", "frequency_hz = true", "markers.frequency_hz", "is not a frequency"),
    ("speed = 1.0", "speed = 2", "speed", "must be 1 on real instruments"),
    ("speed = 1.0", "speed = nan", "speed", "number above 0"),
    # quantities
    (MAX, "max_pressure = inf", "limits.max_pressure", "not a finite pressure"),
    (MAX, 'max_pressure = "1e999 psi"', "limits.max_pressure", "not a finite pressure"),
    (MAX, 'max_pressure = "-4 psi"', "limits.max_pressure", "above 0 psi"),
    (MAX, 'max_pressure = "4 mm"', "limits.max_pressure", "is a length, not"),
    (MAX, 'max_pressure = "3,9 psi"', "limits.max_pressure", "not a number with a unit"),
    (MAX, 'max_pressure = "4 psig"', "limits.max_pressure", "unknown unit, 'psig'"),
    ('ramp = "1 psi/s"', 'ramp = "1 psi"', "limits.ramp", "is a pressure, not a rate of pressure"),
    ('heartbeat = "1 s"', 'heartbeat = "1.1 s"', "limits.heartbeat", "from 0.2 to 1 s"),
    ('stale_after = "0.5 s"', 'stale_after = "3 s"', "limits.stale_after", "from 0.2 to 2 s"),
    ('capture = "1 s"', 'capture = "2 min"', "limits.capture", "from 0.2 to 60 s"),
    ('x = "17.5 mm"', 'x = "140.1 mm"', "markers.points[id 0].x", "from 0 to 140 mm"),
    # keys together
    (MAX, 'max_pressure = "4.1 psi"', "limits.warn_pressure", "above limits.max_pressure"),
    ('trip_pressure = "4.3 psi"', 'trip_pressure = "28 kPa"', "limits.trip_pressure", "4.06106 psi must be"),
    ('safe_pressure = "0.3 psi"', 'safe_pressure = "0.6 psi"', "limits.safe_pressure", "at most 0.5 psi"),
    ('safe_pressure = "0.3 psi"', 'min_pressure = "0.1 psi"', "limits.min_pressure", "from -15 to 0 psi"),
    ('settle_timeout = "30 s"', 'settle_timeout = "3 s"', "limits.settle_timeout", "above limits.settle"),
    ("channels = 32\nd", "channels = 16\nd", "valves.dump_channel", "above the board's valves.channels = 16"),
    ('port = "/dev/ttyUSB1"', 'port = "/dev/ttyUSB0"', "valves.port", "regulator.port"),
    ("id = 7, x = 70, y = 122.5", "id = 7, x = 35, y = 17.5", "markers.points[id 7]", "place of point #2"),
    # tables
    ("[limits]", "[limit]", "limit", 'did you mean "limits"?'),
    ('server_number = 0', "servernumber = 0", "markers.servernumber", 'did you mean "server_number"?'),
    ("server_number = 0", '"a b\\n" = 0', 'markers."a b\\n"', "unknown key"),
    ('server_number = 0', "colour = 0", "markers.colour", "known are driver, frequency_hz"),
    ('port = "/dev/ttyUSB0"\n', "", "regulator.port", "a real rig needs its address"),
    ('host = "192.168.1.230"\n', "", "markers.host", "a real rig needs its address"),
    ('pressure_unit = "psi"\n', "", "regulator.pressure_unit", 'it must be "psi", "kPa"'),
    ("  {id = 7, x = 70, y = 122.5},\n", "", "markers.points", "has 3 points"),
    ("  {id = 7, x = 70, y = 122.5},\n", "  7,\n  8,\n", "markers.points[#4]", "table of keys and values"),
]  # fmt: skip


@pytest.mark.parametrize(
    ("old", "new", "key", "says"), MISTAKES, ids=[f"{row[2]}: {row[3]}" for row in MISTAKES]
)
def test_a_mistake_is_reported_with_its_key_and_what_is_allowed(rig_file, old, new, key, says):
    path = rig_file((old, new))
    with pytest.raises(ConfigError) as caught:
        load_rig(path)
    problems = {problem.key: problem for problem in caught.value.problems}
    problem = problems[key]
    assert says in problem.message
    if problem.value is not None and not key.endswith("]"):
        line = path.read_text().splitlines()[problem.line - 1]
        assert key.rpartition(".")[2] in line


def test_a_mistake_is_reported_with_file_line_and_value(rig_file):
    path = rig_file(('ramp = "1 psi/s"', 'ramp = "1 mm"'))
    line = path.read_text().splitlines().index('ramp = "1 mm"') + 1
    problem = mistake(path)
    assert str(problem) == (
        f'{path}:{line}: limits.ramp = "1 mm": is a length, not a rate of pressure; '
        'write for example "1 psi/s"'
    )


def test_a_missing_key_is_reported_at_its_table(rig_file):
    path = rig_file(('up = "+z"\n', ""))
    problem = mistake(path)
    assert path.read_text().splitlines()[problem.line - 1] == "[markers]"
    assert problem.key == "markers.up"
    assert problem.value is None


def test_a_default_in_conflict_is_named_as_the_default(rig_file):
    path = rig_file(
        ('warn_pressure = "4.1 psi"\n', ""), ('max_pressure = "4.0 psi"', 'max_pressure = "4.2 psi"')
    )
    problem = mistake(path)
    assert problem.key == "limits.warn_pressure"
    assert "default" in problem.message


def test_all_mistakes_of_a_file_are_reported_at_once_in_its_order(rig_file):
    path = rig_file(
        ("speed = 1.0", "sped = 1.0"),
        ('model = "PCD"', 'model = "PC"'),
        ("dump_channel = 32\n", ""),
        ('port = "/dev/ttyUSB1"', 'port = "/dev/ttyUSB0"'),
        ("id = 2, x = 105", "id = 1, x = -105"),
        ('max_pressure = "4.0 psi"', 'max_pressure = "9 psi"'),
        ('vent_timeout = "10 s"', "vent_timeout = nan"),
    )
    with pytest.raises(ConfigError) as caught:
        load_rig(path)
    assert [problem.key for problem in caught.value.problems] == [
        "sped",
        "regulator.model",
        "valves.port",
        "markers.points[id 1].x",
        "markers.points[id 1].id",
        "limits.warn_pressure",
        "limits.vent_timeout",
    ]
    assert str(caught.value).startswith(f"{path} has 7 mistakes:\n")
    assert caught.value.exit_code == 2


def test_a_single_valve_regulator_needs_a_dump_valve(rig_file):
    with_dump = rig_file(('model = "PCD"', 'model = "PC"'))
    assert load_rig(with_dump).regulator.model == "PC"

    without = rig_file(('model = "PCD"', 'model = "PC"'), ("dump_channel = 32\n", ""))
    problem = mistake(without)
    assert problem.key == "regulator.model"
    assert "hold-closed is not vent" in problem.message
    assert "buy a PCD or add a normally-open dump valve" in problem.message


def test_one_port_under_two_names_is_seen(rig_file, tmp_path):
    device, link = tmp_path / "ttyUSB7", tmp_path / "by-id"
    device.touch()
    link.symlink_to(device)
    path = rig_file((' "/dev/ttyUSB0"', f' "{device}"'), (' "/dev/ttyUSB1"', f' "{link}"'))
    assert mistake(path).key == "valves.port"


def test_valves_on_tcp_need_a_host_and_no_port(rig_file):
    to_tcp = ('transport = "rtu"\nport = "/dev/ttyUSB1"', 'transport = "tcp"\nhost = "10.0.0.5"')
    valves = load_rig(rig_file(to_tcp)).valves
    assert (valves.transport, valves.host, valves.tcp_port, valves.port) == ("tcp", "10.0.0.5", 502, "")

    problem = mistake(rig_file((to_tcp[0], 'transport = "tcp"')))
    assert problem.key == "valves.host"
    assert 'transport = "tcp"' in problem.message


@pytest.mark.parametrize(
    "places", [[(10, 10), (20, 20), (30, 30), (90, 90)], [(70, 5), (70, 60), (70, 90), (70, 9)]]
)
def test_points_on_one_line_are_refused(rig_file, places):
    path = rig_file()
    text = path.read_text()
    inline = text[text.index("points = [") : text.index("\n]\n")]
    points = ",".join(f"{{id = {n}, x = {x}, y = {y}}}" for n, (x, y) in enumerate(places))
    path.write_text(text.replace(inline, f"points = [{points}"))
    problem = mistake(path)
    assert problem.key == "markers.points"
    assert "one line" in problem.message


ANYTHING = st.recursive(
    st.none()
    | st.booleans()
    | st.integers()
    | st.floats()
    | st.sampled_from([10**400, "4 psi", "1 s", "3 mm", "+z", "-1 psi"])
    | st.text(max_size=8)
    | st.dates()
    | st.times(),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner, max_size=3),
    max_leaves=5,
)
KEYS = [
    ("name",), ("speed",), ("simulated",), ("regulator",), ("regulator", "port"), ("regulator", "device_id"),
    ("valves",), ("valves", "dump_channel"), ("valves", "transport"), ("markers", "points"),
    ("limits",), ("limits", "max_pressure"), ("limits", "settle"),
    ("markers", "up"), ("stranger",),
]  # fmt: skip


@given(st.dictionaries(st.sampled_from(KEYS), ANYTHING, max_size=3))
@settings(max_examples=300, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_no_value_anywhere_ends_in_another_error(rig_file, changes):
    table = tomllib.loads(rig_file().read_text())
    for (*parents, last), value in changes.items():
        inner = table
        for parent in parents:
            inner = inner.get(parent, {}) if isinstance(inner, dict) else {}
        if isinstance(inner, dict):
            inner[last] = value
    document = Document("rig.toml", "", table, {})
    rig, problems = validate(document, RigFile)
    assert (rig is None) == bool(problems)
    for problem in [*problems, *rig_problems(document)]:
        assert problem.message
        assert "\n" not in str(problem)
    if rig is not None:
        limits = rig.config("rig.toml").limits
        assert all(math.isfinite(value) for value in vars(limits).values())
        assert all(value >= 0 for name, value in vars(limits).items() if name != "min_pressure_psi")


def test_an_exchange_may_not_keep_the_supervisor_waiting_for_long(rig_file):
    path = rig_file()
    path.write_text(path.read_text().replace('timeout = "0.5 s"', 'timeout = "1.5 s"', 1))
    problem = mistake(path)
    assert problem.key == "regulator.timeout"
    assert "at most 1 s" in problem.message


GAUGE = """
[gauge]
driver = "alicat-modbus"
port = "/dev/ttyUSB2"
pressure_unit = "kPa"
"""


def test_a_second_gauge_is_read_from_its_own_table(rig_file):
    path = rig_file()
    assert load_rig(path).gauge is None

    path.write_text(path.read_text() + GAUGE)

    gauge = load_rig(path).gauge
    assert (gauge.name, gauge.driver, gauge.port) == ("second gauge", "alicat-modbus", "/dev/ttyUSB2")
    assert (gauge.pressure_unit, gauge.device_id, gauge.baudrate) == ("kPa", 1, 19200)


@pytest.mark.parametrize(
    ("before", "after", "key", "words"),
    [
        ('port = "/dev/ttyUSB2"\n', "", "gauge.port", "is missing"),
        ("/dev/ttyUSB2", "/dev/ttyUSB0", "gauge.port", "is the port of regulator.port"),
        ("/dev/ttyUSB2", "/dev/ttyUSB1", "gauge.port", "is the port of valves.port"),
        ('"alicat-modbus"', '"thumb"', "gauge.driver", "alicat-ascii"),
        ('"kPa"', '"kPa"\nmodel = "PC"', "gauge.model", "unknown"),
    ],
)
def test_mistakes_in_a_second_gauge_are_named(rig_file, before, after, key, words):
    path = rig_file()
    path.write_text(path.read_text() + GAUGE.replace(before, after))

    problem = mistake(path)

    assert problem.key == key
    assert words in problem.message
