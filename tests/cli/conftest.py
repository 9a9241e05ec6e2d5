"""`labctl` as a person or a script meets it: in this process, on a rig in virtual time, or as a process."""

import pytest
from labctl_process import Running, run_labctl, serve_doubles
from virtual_labctl import VirtualLabctl, labctl_here

from labctl.ledger.ledger import Ledger


@pytest.fixture(scope="session")
def labctl():
    """Run a command in this process."""
    return labctl_here


@pytest.fixture
def lab_with(tmp_path):
    """Make rigs with faults or settings, in virtual time; they are closed when the test ends."""
    made = []

    def make(*faults, **settings):
        made.append(VirtualLabctl(tmp_path, *faults, **settings))
        return made[-1]

    yield make
    for one in made:
        one.close()


@pytest.fixture
def lab(lab_with):
    """A rig in virtual time whose instruments do as they should."""
    return lab_with()


@pytest.fixture(scope="session")
def labctl_process():
    """Run a command as a process."""
    return run_labctl


@pytest.fixture
def start():
    """Start a labctl in the background; it is gone when the test ends."""
    running = []

    def begin(*arguments):
        running.append(Running(*arguments))
        return running[-1]

    yield begin
    for one in running:
        one.close()


@pytest.fixture(scope="session")
def served(tmp_path_factory):
    """Doubles in a process of their own, shared by the tests that leave them SAFE."""
    with serve_doubles(tmp_path_factory.mktemp("doubles")) as doubles:
        yield doubles


@pytest.fixture
def doubles_with(tmp_path):
    """Doubles in a process of their own, with options of the test's own."""
    return lambda *options: serve_doubles(tmp_path, *options)


@pytest.fixture(scope="session")
def trials_of():
    """The trials of a run of a ledger."""

    def read(folder, run=1):
        with Ledger.open(folder, lambda _: None) as ledger:
            return ledger.trials(run)

    return read


@pytest.fixture(scope="session")
def kinds_of():
    """The kinds of the events of a run of a ledger."""

    def read(folder, run=1):
        with Ledger.open(folder, lambda _: None) as ledger:
            return [event.kind for event in ledger.events(run)]

    return read
