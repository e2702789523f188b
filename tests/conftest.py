"""Settings of all tests, and what several of them use."""

import sys

import pytest
from hypothesis import HealthCheck, settings
from jaxtyping import install_import_hook

# Shapes and types of arguments are checked in every test. The last jaxtyping for Python 3.10 cannot leave the
# compiled functions alone, and numba does not compile what it wraps.
if sys.version_info >= (3, 11):
    install_import_hook("grasptransfer", "typechecker.check")

# Machines are shared: how long an example takes says nothing about the code. Each run tries the same
# examples, so that no change fails by luck; `pytest --hypothesis-profile search` tries new ones.
any_speed = settings(deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.register_profile("search", any_speed)
settings.register_profile("same", any_speed, derandomize=True)
settings.load_profile("same")


@pytest.fixture(scope="session")
def training_set(tmp_path_factory):
    """The folder of four training samples."""
    from small_training_set import build_small

    return build_small(tmp_path_factory.mktemp("training_set"))
