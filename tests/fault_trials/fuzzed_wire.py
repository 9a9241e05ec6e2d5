"""A wire between a real link and a double's line, in the same thread, that spoils replies on their way.

Its time moves by waiting and by bytes alone, so that a million replies with all their time-outs take minutes.
"""

from collections import deque

from labctl.errors import LinkDown, NoAnswer

MISHAPS = (
    "flipped bits",
    "cut off",
    "bytes lost",
    "bytes put in",
    "twice",
    "another request's reply",
    "random bytes",
    "lost",
    "late",
    "in two pieces",
)
BYTE_S = 10 / 19200
CHUNK_BYTES = 32
LATEST_S = 0.9
# A USB adapter holds bytes back for up to 16 ms.
LONGEST_GAP_S = 0.02
# A call waits at most a few hundred times; one that looks so often will not end.
MOST_LOOKS = 100_000


class FuzzClock:
    """A `labctl.clock.Scheduler` for one thread: nobody else ever holds a lock."""

    def __init__(self):
        self.time_s = 1000.0

    def now_s(self):
        return self.time_s

    def sleep(self, seconds):
        self.time_s += max(0.0, seconds)

    def lock(self):
        return _FreeLock()


class _FreeLock:
    def acquire(self, timeout_s=None):
        return True

    def release(self):
        pass


class Spoiler:
    """Spoils a share of the replies; counts them by what happened.

    `counts` knows the replies by which a driver reads, or knows that a line is in step, where nothing tells to which
    request they belong. These come late or twice, but never out of turn: nobody could see that.
    """

    def __init__(self, rng, share, counts):
        self.share = share
        self.rng = rng
        self.counts = dict.fromkeys(MISHAPS, 0)
        self._counts = counts
        self._heard = deque(maxlen=200)
        self._changed = deque(maxlen=20)

    @property
    def fuzzed(self):
        return sum(self.counts.values())

    def was_said(self, frame):
        """Whether a device said this lately, and the wire did not make it up."""
        return frame in self._heard and not any(frame in changed for changed in self._changed)

    def spoil(self, reply):
        """Pieces of bytes that come in place of the reply, each with how much later than it."""
        pieces = self._pieces(reply)
        data = b"".join(piece for _, piece in pieces)
        if data not in (reply, reply + reply):
            self._changed.append(data)
        return pieces

    def _pieces(self, reply):
        rng = self.rng
        self._heard.append(reply)
        if not reply or rng.random() >= self.share:
            return [(0.0, reply)]
        mishap = MISHAPS[rng.randrange(len(MISHAPS))]
        others = [heard for heard in list(self._heard)[-20:] if heard != reply and not self._counts(heard)]
        if mishap == "another request's reply" and not others:
            mishap = "random bytes"
        self.counts[mishap] += 1
        at = rng.randrange(len(reply))
        if mishap == "flipped bits":
            changed = bytearray(reply)
            for _ in range(rng.choice((1, 1, 1, 2, 3, 8))):
                changed[rng.randrange(len(reply))] ^= 1 << rng.randrange(8)
            return [(0.0, bytes(changed))]
        if mishap == "cut off":
            return [(0.0, reply[:at] if rng.random() < 0.5 else reply[at + 1 :])]
        if mishap == "bytes lost":
            return [(0.0, reply[:at] + reply[at + rng.choice((1, 1, 2, 4)) :])]
        if mishap == "bytes put in":
            return [(0.0, reply[:at] + rng.randbytes(rng.choice((1, 1, 2, 8))) + reply[at:])]
        if mishap == "twice":
            return [(0.0, reply + reply)]
        if mishap == "another request's reply":
            return [(0.0, rng.choice(others))]
        if mishap == "random bytes":
            return [(0.0, rng.randbytes(rng.randrange(1, 2 * len(reply) + 2)))]
        if mishap == "lost":
            return []
        if mishap == "late":
            return [(rng.uniform(0.0, LATEST_S), reply)]
        return [(0.0, reply[:at]), (rng.uniform(0.0, LONGEST_GAP_S), reply[at:])]


class FuzzedWire:
    """A serial port and a TCP connection at once; what is on its way when it is closed never arrives.

    `arrived` is what came since `begin`, for judging a value; `story` what was asked and sent, for people.
    """

    def __init__(self, line, clock, spoiler, name="instrument"):
        self.name = f"{name} on a fuzzed wire"
        self.clock = clock
        self._line, self._spoiler = line, spoiler
        self._coming = deque()
        self._held = bytearray()
        self._looks = 0
        self._closed = False
        self.arrived = bytearray()
        self.story = []

    def begin(self):
        """A call begins."""
        self._looks = 0
        self.arrived = bytearray(self._held)
        self.story = [("was on its way", *self._coming)] if self._coming else []

    def write(self, data, deadline):
        self._look()
        self.clock.sleep(len(data) * BYTE_S)
        replies = self._line.receive(data)
        if self._line.waiting:
            replies += self._line.idle()
        for reply in replies:
            pieces = self._spoiler.spoil(reply)
            self.story.append((bytes(data), "as", *pieces, "in place of", reply))
            # A device answers in order, and a long answer takes its time.
            at_s = max(self.clock.now_s(), self._coming[-1][0] if self._coming else 0.0)
            for later_s, piece in pieces:
                at_s += later_s
                for start in range(0, len(piece), CHUNK_BYTES):
                    chunk = piece[start : start + CHUNK_BYTES]
                    at_s += len(chunk) * BYTE_S
                    self._coming.append((at_s, chunk))

    send = write

    def read_some(self, limit, deadline):
        while not self._look():
            remaining_s = deadline.remaining_s()
            if remaining_s <= 0:
                return b""
            self._wait(remaining_s)
        data = bytes(self._held[:limit])
        del self._held[:limit]
        return data

    def has_input(self):
        return self._look()

    def read_exactly(self, n, deadline):
        data = self.peek(n, n, deadline)
        self.skip(n)
        return data

    def peek(self, n, most, deadline):
        while not self._look() or len(self._held) < n:
            remaining_s = deadline.remaining_s()
            if remaining_s <= 0:
                raise NoAnswer(f"{self.name}: {len(self._held)} of {n} bytes came")
            self._wait(remaining_s)
        return bytes(self._held[:most])

    def skip(self, n):
        del self._held[:n]

    def abort(self):
        self.close()

    def close(self):
        self._closed = True

    def _wait(self, most_s):
        due_s = self._coming[0][0] - self.clock.now_s() if self._coming else most_s
        self.clock.sleep(min(most_s, max(due_s, 0.0)) + 1e-9)

    def _look(self):
        if self._closed:
            raise LinkDown(f"{self.name}: it is closed")
        self._looks += 1
        assert self._looks < MOST_LOOKS, "the call does not come to its end"
        while self._coming and self._coming[0][0] <= self.clock.time_s:
            piece = self._coming.popleft()[1]
            self._held += piece
            self.arrived += piece
        return bool(self._held)
