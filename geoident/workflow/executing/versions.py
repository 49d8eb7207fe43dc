"""Of which versions the programs are that compute here.

By itself, since who only shows results asks for them too, and needs nothing of what computes.
"""

from __future__ import annotations

import platform
from functools import cache
from importlib.metadata import version

from geoident import __version__

_DECISIVE = ("numpy", "scipy", "h5py")

_version = cache(version)  # which reads a text of hundreds of lines: a tenth of a small fit


def versions() -> dict[str, str]:
    """Versions of geoident, of Python and of the libraries that numbers go through."""
    return decisive_versions() | {name: _version(name) for name in ("meshio", "pyyaml", "pydantic")}


def decisive_versions() -> dict[str, str]:
    """Those on which numbers depend, or what is sent to workers of a cluster."""
    own = {"geoident": __version__, "python": platform.python_version()}
    return own | {name: _version(name) for name in _DECISIVE}
