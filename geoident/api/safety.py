"""Factors of safety by strength reduction, of a case and of a fit."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import replace

from geoident.api.calling import AnyPath, processes, spoken
from geoident.api.cases import CaseFile, origin_of
from geoident.api.results import FitResult
from geoident.io.result.file import read_identity
from geoident.model.results.safety import StageSafety
from geoident.report.text.safety import safety_text
from geoident.workflow.running.control import Control
from geoident.workflow.running.jobs import Request
from geoident.workflow.safety import DRAWS, Safety, SafetyRequest, safety_of_case, safety_of_fit


class SafetyResult:
    """What `safety` found.

    Args:
        found: by the command.

    Attributes:
        factors: stage to its factor of safety, with its bracket.
        bands: stage to what the fit makes of it; empty for a case.
        mechanism: how the ground moves as the stage of the smallest factor fails, or None.
        path: of the result, such as ``case.safety.h5``.
        status: ``done``, ``poor-fit`` or ``not-determined``.
    """

    def __init__(self, found: Safety) -> None:
        self._result = result = found.result
        self.factors: dict[str, StageSafety] = {one.stage: one for one in result.safety}
        self.bands = {name: one for name, one in self.factors.items() if one.of_fit}
        self.mechanism = result.mechanism
        self.path = found.finished.paths[0]
        self.status = result.status

    def __str__(self) -> str:
        return safety_text(self._result)

    def __repr__(self) -> str:
        values = ", ".join(f"{stage!r}: {one.value:.3g}" for stage, one in self.factors.items())
        return f"SafetyResult({values})"


@spoken
def safety(
    of: CaseFile | FitResult | AnyPath,
    *,
    stages: str | Sequence[str] = (),
    draws: int = DRAWS,
    seed: int | None = None,
    output: AnyPath | None = None,
    force: bool = False,
    fresh: bool = False,
    jobs: int | None = 1,
    solver: str = "auto",
) -> SafetyResult:
    """Divide the strength of the ground until no equilibrium is left.

    Args:
        of: a case, at its start values, or the result of a fit, or the path of either.
        stages: one or several; the last one if empty.
        draws: of the posterior of a fit at which the factor is computed.
        seed: of these; that of the fit if None.
        output: file or existing folder of the result; beside the case or fit if None.
        force: replace what stands there.
        fresh: compute again what is up to date.
        jobs: processes for the draws; None for all cores, where that saves time.
        solver: name of the sparse solver, or ``auto``.

    Raises:
        InputError: the case or the result is wrong, or no ground has strength to divide.
        UsageError: there is no such stage, or the case has no mesh.
        ModelError: the model has no solution even with much more strength.
        OutputError: something stands in the place of the file, or it cannot be written.
    """
    chosen = (stages,) if isinstance(stages, str) else tuple(stages)
    path = of.path if isinstance(of, FitResult | CaseFile) else os.fspath(of)
    request = Request(
        path, output=None if output is None else os.fspath(output), solver=solver, force=force,
        fresh=fresh,
    )  # fmt: skip
    asked = SafetyRequest(request, chosen, draws=draws, seed=seed)
    of_fit = not isinstance(of, CaseFile) and read_identity(path) is not None
    if of_fit or isinstance(of, FitResult):
        return SafetyResult(safety_of_fit(asked, Control(jobs=processes(jobs))))
    origin = origin_of(of)
    request = replace(request, case=origin.path, overrides=origin.overrides, text=origin.text)
    return SafetyResult(safety_of_case(replace(asked, request=request), Control()))
