"""Settings of all tests."""

import sys

from hypothesis import settings
from jaxtyping import install_import_hook

# Shapes and types of arguments are checked in every test. The last jaxtyping for Python 3.10 cannot leave the
# compiled functions alone, and numba does not compile what it wraps.
if sys.version_info >= (3, 11):
    install_import_hook("grasptransfer", "typechecker.check")

# Machines are shared: how long an example takes says nothing about the code.
settings.register_profile("any-speed", deadline=None)
settings.load_profile("any-speed")
