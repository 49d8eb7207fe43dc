"""Of which versions the programs are that compute here.

By itself, since who only shows results asks for them too, and needs nothing of what computes.
"""

from __future__ import annotations

import platform
from functools import cache
from importlib.metadata import version

from geoident import __version__

LIBRARIES = ("numpy", "scipy", "h5py", "meshio", "pyyaml", "pydantic")


def versions() -> dict[str, str]:
    """Versions of geoident, of Python and of the libraries that numbers go through."""
    return dict(_versions())


@cache
def _versions() -> dict[str, str]:
    """The same; looking for them takes 5 ms, and they stay while a process runs."""
    own = {"geoident": __version__, "python": platform.python_version()}
    return own | {name: version(name) for name in LIBRARIES}
