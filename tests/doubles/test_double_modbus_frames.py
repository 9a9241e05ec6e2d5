import pytest

from labctl.doubles.modbus_frames import TcpFrame, crc16, open_rtu_frame, rtu_frame, take_tcp_frame

# Frames as the Waveshare wiki prints them.
MANUAL_FRAMES = [
    "01 05 00 00 FF 00 8C 3A",
    "01 05 00 FF FF 00 BC 0A",
    "01 05 00 FF 00 00 FD FA",
    "01 05 02 00 00 07 8D B0",
    "01 01 00 00 00 08 3D CC",
    "01 0F 00 00 00 14 03 00 00 00 50 75",
]


@pytest.mark.parametrize("frame", [bytes.fromhex(frame) for frame in MANUAL_FRAMES])
def test_manual_frames_open_and_close_to_the_same_bytes(frame):
    assert open_rtu_frame(frame) == (1, frame[1:-2])
    assert rtu_frame(1, frame[1:-2]) == frame


def test_crc_check_value():
    assert crc16(b"123456789") == 0x4B37


def test_one_flipped_bit_anywhere_closes_a_frame():
    frame = bytes.fromhex(MANUAL_FRAMES[0])
    for position in range(len(frame) * 8):
        broken = bytearray(frame)
        broken[position // 8] ^= 1 << position % 8
        assert open_rtu_frame(bytes(broken)) is None


def test_tcp_frames_are_cut_off_one_by_one():
    first = bytes.fromhex("00 01 00 00 00 06 01 01 00 00 00 14")
    second = bytes.fromhex("00 02 00 00 00 06 01 05 00 00 FF 00")
    buffer = bytearray(first + second[:5])
    assert take_tcp_frame(buffer) == TcpFrame(1, 1, first[7:])
    assert take_tcp_frame(buffer) is None
    buffer += second[5:]
    frame = take_tcp_frame(buffer)
    assert frame is not None
    assert frame.encoded() == second
    assert buffer == b""


@pytest.mark.parametrize("header", ["00 01 00 01 00 06 01", "00 01 00 00 00 01 01", "00 01 00 00 01 00 01"])
def test_what_is_no_modbus_tcp_is_refused(header):
    with pytest.raises(ValueError, match="no Modbus TCP"):
        take_tcp_frame(bytearray.fromhex(header))
