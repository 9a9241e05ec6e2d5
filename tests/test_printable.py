import pytest

from labctl.errors import GarbledReply
from labctl.instruments.readings import Identity
from labctl.printable import printable


def test_text_without_commands_is_as_it_was():
    assert printable("PCD-15PSIG-D µ 0.5 °C") == "PCD-15PSIG-D µ 0.5 °C"


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("PCD\x1b[2J", r"PCD\x1b[2J"),
        ("\x9b31m", r"\x9b31m"),
        ("a\x00b\x07\r\n", r"a\x00b\x07\r\n"),
        ("left\u202eright", r"left\u202eright"),
        ("\udcff", r"\udcff"),
    ],
)
def test_what_a_terminal_would_obey_is_written_out(text, shown):
    assert printable(text) == shown


def test_an_error_may_have_lines_and_nothing_else_that_is_not_printable():
    assert str(GarbledReply("rig.toml:\n\tset to \x1b]0;x\x07")) == "rig.toml:\n\tset to \\x1b]0;x\\x07"


def test_an_identity_is_safe_to_print_whatever_the_device_calls_itself():
    identity = Identity("PCD\x1b[2J", serial_number="12\n3", firmware="\x1bc", notes=("at \x07",))
    assert identity.describe() == r"PCD\x1b[2J, serial number 12\n3, firmware \x1bc"
    assert identity.notes == (r"at \x07",)
