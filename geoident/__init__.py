"""geoident identifies the material parameters of ground models from gauge readings.

From Python: ``from geoident import fit, load_case, predict`` (see `geoident.api` for all names and
an example), loaded when first asked for, so that the command line starts fast.
"""

# ruff: noqa: PTH100, PTH120 - nothing more is imported before the current folder is out of the way

import os
import sys

if not sys.flags.safe_path and sys.argv[:1] == ["-m"]:  # so for Python while it looks for a module
    _words = zip(sys.orig_argv, sys.orig_argv[1:], strict=False)
    if any(word == "geoident" and flag.endswith("m") for flag, word in _words):
        # By `python -m geoident` the current folder comes first, and who knows what lies there.
        del sys.path[0]
        _own = os.path.dirname(os.path.dirname(os.path.abspath(__file__)))
        sys.path += [_own] if _own not in sys.path else []

from importlib import import_module
from types import ModuleType
from typing import Any

__version__ = "0.1.0"

_API = (
    "AnyPath",
    "BacktestResult",
    "CampaignResult",
    "CaseFile",
    "ChannelReadings",
    "CheckResult",
    "ControlResult",
    "Drawing",
    "FitResult",
    "GaugeReadings",
    "KeptModel",
    "ModelChoice",
    "ParameterEstimate",
    "Parameters",
    "PlanResult",
    "PredictionResult",
    "Progress",
    "ProjectFit",
    "ReducedReadings",
    "ResultFile",
    "ResultTable",
    "SafetyResult",
    "SampleResult",
    "ScanResult",
    "SectionFit",
    "SimulationResult",
    "backtest",
    "batch",
    "check",
    "compare",
    "control",
    "export",
    "fit",
    "fit_project",
    "init",
    "load_case",
    "plan",
    "predict",
    "read_project",
    "read_result",
    "report",
    "safety",
    "sample",
    "scan",
    "simulate",
    "trust",
    "update",
)


__all__ = ["__version__", *_API]  # noqa: PLE0604 - they are texts


class _Package(ModuleType):
    """This package, in which `report` is a function, though a folder of it has that name too.

    Importing a module puts it into its package under its own name, in place of what is there. A
    property of the class comes first, so that ``from geoident import report`` means the same
    whatever was imported before; ``from geoident.report.text import ...`` goes on to work.
    """

    @property
    def report(self) -> Any:
        """Write the report: `geoident.api.report`."""
        return import_module("geoident.api").report

    @report.setter
    def report(self, module: ModuleType) -> None:
        """What importing the folder does; it is in `sys.modules` anyway."""


sys.modules[__name__].__class__ = _Package


def __getattr__(name: str) -> Any:
    """Names of the Python interface, on demand."""
    if name in _API:
        return getattr(import_module("geoident.api"), name)
    msg = f"module 'geoident' has no attribute '{name}'"
    raise AttributeError(msg)


def __dir__() -> list[str]:
    return sorted([*globals(), *_API])
