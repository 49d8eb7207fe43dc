"""geoident identifies the material parameters of ground models from gauge readings.

From Python: ``from geoident import fit, load_case, predict`` (see `geoident.api`), loaded when
first asked for, so that the command line starts fast.
"""

from importlib import import_module
from typing import Any

__version__ = "0.1.0"

_API = ("CaseFile", "Found", "ParameterEstimate", "fit", "load_case", "predict", "sample")


def __getattr__(name: str) -> Any:
    """Names of the Python interface, on demand."""
    if name in _API:
        return getattr(import_module("geoident.api"), name)
    msg = f"module 'geoident' has no attribute '{name}'"
    raise AttributeError(msg)


def __dir__() -> list[str]:
    return sorted([*globals(), *_API])
