import threading

from labctl.nonblocking_output import NonBlockingOutput

# As long as it takes to give the output's thread its turn; no test waits for as long.
PATIENT_S = 300.0


def test_everything_is_written_in_order():
    written = []
    output = NonBlockingOutput(written.append)
    for number in range(20):
        output.write(str(number))
    output.finish(PATIENT_S)
    assert written == [str(number) for number in range(20)]


def test_a_reader_that_is_stuck_makes_nobody_wait():
    gate = threading.Event()
    received = []

    def read(text):
        gate.wait(PATIENT_S)
        received.append(text)

    output = NonBlockingOutput(read)
    for _ in range(10_000):
        output.write("still here")
    output.finish(0.05)
    assert received == []
    gate.set()


def test_a_reader_that_fails_fails_alone():
    written = []

    def write(text):
        if text == "bad":
            raise OSError("no space left")
        written.append(text)

    output = NonBlockingOutput(write)
    output.write("bad")
    output.write("good")
    output.finish(PATIENT_S)
    assert written == ["good"]
