import threading

from labctl.nonblocking_output import NonBlockingOutput


def test_says_everything_in_order():
    written = []
    output = NonBlockingOutput(written.append)
    for number in range(20):
        output.write(str(number))
    output.finish()
    assert written == [str(number) for number in range(20)]


def test_a_reader_that_is_stuck_makes_nobody_wait():
    gate = threading.Event()
    output = NonBlockingOutput(lambda text: gate.wait(10))
    for _ in range(10_000):
        output.write("still here")
    output.finish(0.05)
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
    output.finish()
    assert written == ["good"]
