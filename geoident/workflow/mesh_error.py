"""``geoident check --mesh-error``: how much of each reading's accuracy is lost to mesh error."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from geoident.errors import InputError
from geoident.fem.solvers.threads import one_thread
from geoident.forward.model import StagedModel
from geoident.io.result.file import read_result
from geoident.model.results.mesh_error import MeshError
from geoident.workflow.estimating.mesh_error import mesh_error, mesh_sentence
from geoident.workflow.estimating.step_error import step_error, steps_sentence, takes_steps
from geoident.workflow.running.jobs import (
    build_model,
    inputs_of_result,
    load_inputs,
    require_stages,
    start_values,
)
from geoident.workflow.running.result_files import case_path

RESULT = ".h5"
"""Ending of result files, of which the parameters are taken."""


@dataclass(frozen=True)
class MeshChecked:
    """What the mesh of a case does to its readings.

    Args:
        table: by channel and stage.
        sentence: what it means.
    """

    table: MeshError
    sentence: str


@one_thread()
def check_mesh_error(
    path: str, *, overrides: Sequence[str] = (), solver: str = "auto"
) -> MeshChecked:
    """Halve the edges of the mesh of a case and compare its readings.

    Args:
        path: of the case, at whose start values it is solved, or of a result of a fit, at whose
            parameters; ``-`` for stdin.
        overrides: ``KEY=VALUE`` in place of what the case says.
        solver: name of the sparse solver, or ``auto``.

    Raises:
        InputError: the case is faulty, or has no mesh.
        ModelError: the model has no solution at these values.
    """
    if path.endswith(RESULT):
        result = read_result(path)
        inputs = inputs_of_result(result, case_path(path, result.provenance.case_file))
        known = dict(zip(result.parameters.names, result.parameters.values, strict=True))
    else:
        inputs, known = load_inputs(path, overrides=overrides), {}
    require_stages(inputs.case)
    model = build_model(inputs, solver=solver)
    if not isinstance(model, StagedModel):
        fault = inputs.case.source.fault(
            ("mesh",), "no-mesh", "the case has no mesh: a closed form has no error"
        )
        raise InputError([fault])
    values = start_values(model.case, model)
    at = np.array([known.get(n, x) for n, x in zip(model.names, values, strict=True)])
    table = mesh_error(model, inputs.case, at)
    if takes_steps(inputs.case):
        said = steps_sentence(step_error(model, at))
        table = replace(table, notes=(*table.notes, said))
    table = replace(table, cost=model.counts + table.cost)
    if len(at):
        table = replace(table, notes=(_where(path), *table.notes))
    which = np.isfinite(table.error)
    return MeshChecked(table, mesh_sentence(table, which))


def _where(path: str) -> str:
    """At which parameters the error was computed, a sentence."""
    if path.endswith(RESULT):
        return "Computed at the parameters of the fit."
    return (
        "Computed at the start values of the parameters; motions, and their errors, go with the "
        "stress and against the stiffness. After a fit, 'geoident check CASE.fit.h5 --mesh-error' "
        "computes at its answer."
    )
