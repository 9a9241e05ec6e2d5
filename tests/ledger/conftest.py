import shutil
from dataclasses import replace

import pytest
from made_ledger import Notices, make_ledger


@pytest.fixture
def notices():
    return Notices()


@pytest.fixture(scope="session")
def pristine(tmp_path_factory):
    """A ledger that was closed; nobody changes it."""
    return make_ledger(tmp_path_factory.mktemp("pristine") / "ledger")


@pytest.fixture
def kept(pristine, tmp_path):
    """A ledger of the test's own."""
    return copy_of(pristine, tmp_path / "ledger")


@pytest.fixture
def copy_kept(pristine, tmp_path):
    """As many ledgers as the test wants."""
    return lambda name: copy_of(pristine, tmp_path / str(name))


def copy_of(kept, folder):
    shutil.copytree(kept.folder, folder)
    return replace(kept, folder=folder)
