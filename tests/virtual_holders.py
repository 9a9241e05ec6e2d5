"""Who holds which rig, in a test's own process: what `labctl.holder.system` does with files, sockets and signals."""

from dataclasses import replace

from labctl.errors import LabError, NoAnswer
from labctl.holder.interfaces import RigHeld
from labctl.holder.records import VERSION, Entry, Request

_PERIOD_S = 0.05


class VirtualHolders:
    """Every rig that is held by somebody in this process; `ended` are the processes that were ended."""

    def __init__(self, time):
        self.time = time
        self.holdings = []
        self.ended = []

    def hold(self, holder, addresses, reach, answerer, patience_s):
        end_s = self.time.now_s() + patience_s
        while found := self.find(addresses):
            if self.time.now_s() >= end_s:
                raise RigHeld(found[0])
            self.time.sleep(0.02)
        holding = VirtualHolding(self, Entry(VERSION, holder, tuple(addresses), reach), answerer)
        self.holdings.append(holding)
        return holding

    def find(self, addresses):
        return tuple(
            VirtualHeld(self, each) for each in self.holdings if set(each.entry.addresses) & set(addresses)
        )

    def all(self):
        return tuple(VirtualHeld(self, each) for each in self.holdings)


class VirtualHolding:
    """A rig that is held. `is_silent`: its process has stopped; `on_end` is done when it is ended."""

    def __init__(self, holders, entry, answerer):
        self._holders = holders
        self.entry, self.answerer = entry, answerer
        self.is_silent = answerer is None
        self.on_end = None
        self.last = None

    def release(self):
        if self.answerer is not None and not self.is_silent:
            self.last = replace(self.answerer.state(), ended=True)
        if self in self._holders.holdings:
            self._holders.holdings.remove(self)


class VirtualHeld:
    """A rig that was held when it was looked for."""

    def __init__(self, holders, holding):
        self._holders, self._holding = holders, holding
        self.entry = holding.entry

    def is_held(self):
        return self._holding in self._holders.holdings

    def ask(self, word, timeout_s):
        if self._holding.is_silent:
            self._holders.time.sleep(timeout_s)
            raise NoAnswer(f"process {self.entry.holder.pid} took no request")
        if word in ("vent", "abort"):
            self._holding.answerer.request(word, Request(VERSION, word, 4711, "anna"))
        return VirtualConversation(self._holders, self._holding)

    def end(self):
        if self._holding.on_end is None:
            raise LabError(f"process {self.entry.holder.pid} cannot be ended from here")
        self._holders.ended.append(self.entry.holder.pid)
        self._holding.release()
        self._holding.on_end()


class VirtualConversation:
    """The states of a holder, one after the other."""

    def __init__(self, holders, holding):
        self._holders, self._holding = holders, holding
        self._asked = self._ended = False

    def next_state(self, timeout_s):
        if self._asked:
            self._holders.time.sleep(_PERIOD_S)
        self._asked = True
        if self._holding.is_silent:
            self._holders.time.sleep(timeout_s)
            raise NoAnswer(f"process {self._holding.entry.holder.pid} has not answered for {timeout_s:g} s")
        if self._holding not in self._holders.holdings:
            last, self._ended = (None if self._ended else self._holding.last), True
            return last
        return self._holding.answerer.state()

    def close(self):
        pass
