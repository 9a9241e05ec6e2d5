import threading

from labctl.nonblocking_output import NonBlockingOutput


def test_says_everything_in_order():
    said = []
    teller = NonBlockingOutput(said.append)
    for number in range(20):
        teller.tell(str(number))
    teller.finish()
    assert said == [str(number) for number in range(20)]


def test_a_listener_that_is_stuck_makes_nobody_wait():
    gate = threading.Event()
    teller = NonBlockingOutput(lambda text: gate.wait(10))
    for _ in range(10_000):
        teller.tell("still here")
    teller.finish(0.05)
    gate.set()


def test_a_listener_that_fails_fails_alone():
    said = []

    def write(text):
        if text == "bad":
            raise OSError("no space left")
        said.append(text)

    teller = NonBlockingOutput(write)
    teller.tell("bad")
    teller.tell("good")
    teller.finish()
    assert said == ["good"]
