import threading

from labctl.nonblocking_output import NonBlockingOutput

# As long as it takes to give the output's thread its turn; no test waits for as long.
PATIENT_S = 300.0


def test_says_everything_in_order():
    said = []
    teller = NonBlockingOutput(said.append)
    for number in range(20):
        teller.write(str(number))
    teller.finish(PATIENT_S)
    assert said == [str(number) for number in range(20)]


def test_a_listener_that_is_stuck_makes_nobody_wait():
    gate = threading.Event()
    heard = []

    def listen(text):
        gate.wait(PATIENT_S)
        heard.append(text)

    teller = NonBlockingOutput(listen)
    for _ in range(10_000):
        teller.write("still here")
    teller.finish(0.05)
    assert heard == []
    gate.set()


def test_a_listener_that_fails_fails_alone():
    said = []

    def write(text):
        if text == "bad":
            raise OSError("no space left")
        said.append(text)

    teller = NonBlockingOutput(write)
    teller.write("bad")
    teller.write("good")
    teller.finish(PATIENT_S)
    assert said == ["good"]
