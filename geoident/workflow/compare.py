"""``geoident compare``: which of several models of the same readings these ask for."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from geoident.io.result.file import read_result
from geoident.model.results.rivals import ModelComparison
from geoident.workflow.scoring.comparison import Candidate, compared


def compare(paths: Sequence[str]) -> ModelComparison:
    """Compare the models of several fits by evidence and backtest.

    Args:
        paths: of results of ``geoident fit``, at least two.

    Raises:
        InputError: one of them is no fit, has no evidence, or is of other readings.
    """
    names = _names(paths)
    pairs = zip(names, paths, strict=True)
    return compared([Candidate(name, path, read_result(path)) for name, path in pairs])


def _names(paths: Sequence[str]) -> list[str]:
    """What to call the models: names of files, or paths where two names are the same."""
    short = [Path(path).name.removesuffix(".h5").removesuffix(".fit") for path in paths]
    return short if len(set(short)) == len(short) else list(paths)
