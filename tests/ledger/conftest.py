import pytest
from made_ledger import Told, make_ledger


@pytest.fixture
def told():
    return Told()


@pytest.fixture
def kept(tmp_path):
    return make_ledger(tmp_path / "ledger")
