import pytest

from tests.envs.helpers import KINDS, Kind, make_gte


@pytest.fixture(scope="module", params=KINDS)
def kind(request) -> Kind:
    """SJE and GTE."""
    return KINDS[request.param]


@pytest.fixture(scope="module")
def env(kind):
    """The Panda's environment in short episodes."""
    return kind.make()


@pytest.fixture(scope="module")
def panda():
    """The Panda's GTE environment."""
    return make_gte()
