"""``geoident simulate``: what the gauges would read at the start values of the parameters."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import Enum
from pathlib import Path

import numpy as np

from geoident.errors import CollapseError, InputError, Term, UsageError
from geoident.fem.solvers.threads import one_thread
from geoident.forward.external.model import ExternalModel
from geoident.forward.model import StagedModel
from geoident.forward.observed import ObservedModel
from geoident.forward.reduced.case_model import ReducedCaseModel
from geoident.io.bridges.values import WrittenValue, read_values, values_of
from geoident.io.result.hdf5 import hdf5_output
from geoident.io.result.structure_cells import structure_series, write_structures_vtkhdf
from geoident.io.result.vtkhdf import add_principal_stresses, write_fields
from geoident.io.text.atomic import atomic_output, refuse_inputs
from geoident.model.arrays import Floats
from geoident.model.case import Case
from geoident.model.gauges import Reading, named_channels
from geoident.model.results.costs import Counts
from geoident.model.results.result import FieldSeries
from geoident.model.results.times import StageTimes
from geoident.model.results.yielded import Mechanism
from geoident.workflow.running.computed import silent_gauges
from geoident.workflow.running.jobs import (
    NO_READINGS,
    Inputs,
    build_model,
    load_inputs,
    require_stages,
    start_values,
)
from geoident.workflow.running.kept_reduced import answer_note, answered, restored_for
from geoident.workflow.running.readings import error_structure


class Noise(Enum):
    """What is added to the readings of the model."""

    NONE = "nothing"
    ACCURACY = "Gaussian noise with the accuracy of each gauge"


@dataclass(frozen=True)
class ComputedBy:
    """What computes readings, and at which parameters.

    Args:
        solver: name of the sparse solver, or ``auto``.
        reduced: path of a result whose reduced model answers where that is close enough; None to
            compute the model.
        values: path of a table of values of parameters in place of their start values; None for
            those.
    """

    solver: str = "auto"
    reduced: str | None = None
    values: str | None = None


BY_MODEL = ComputedBy()
"""By the model, with the solver that suits it."""


@dataclass(frozen=True)
class Outputs:
    """What is written of a simulation.

    Args:
        readings: file into which its caller is going to write the readings, or None.
        fields: file for the displacements, stresses and principal stresses of all states, as
            VTKHDF; or None.
        force: replace fields that stand there.
    """

    readings: str | None = None
    fields: str | None = None
    force: bool = False


NOTHING_WRITTEN = Outputs()
"""No files."""


@dataclass(frozen=True)
class Simulated:
    """Readings of the model.

    Args:
        path: of the case; ``-`` for stdin.
        case: whose gauges they are.
        readings: by stage, SI.
        files_read: paths of all that the case consists of, which no output may replace.
        note: gauges that are left out at some stages, and whose the readings are, where a reduced
            model was asked; empty else.
        inputs: the case as it was read.
        values: (n,) of the parameters, SI.
        computed: (n_channels, n_stages) by the model, without noise, SI.
        counts: what it cost.
        fields: the states, where they were asked for.
        written: files that were written.
    """

    path: str
    case: Case
    readings: tuple[Reading, ...]
    files_read: tuple[str, ...]
    note: str
    inputs: Inputs
    values: Floats
    computed: Floats
    counts: Counts
    fields: FieldSeries | None = None
    written: tuple[str, ...] = ()


@one_thread()
def simulate(
    path: str,
    *,
    overrides: Sequence[str] = (),
    noise: Noise = Noise.NONE,
    draw: bool = False,
    seed: int = 0,
    by: ComputedBy = BY_MODEL,
    to: Outputs = NOTHING_WRITTEN,
    text: str | None = None,
) -> Simulated:
    """Readings of all gauges at all stages where they can be read, by stage.

    A gauge is left out at the stage at which it is zeroed: it reads zero there, by definition.

    Args:
        path: of the case; ``-`` for stdin.
        overrides: ``KEY=VALUE`` in place of what the case says.
        noise: what is added.
        draw: the fields of the case are drawn from what is known of them before readings.
        seed: of the noise and of what is drawn.
        by: what computes them.
        to: what is written, and where.
        text: of the case where it stands in no file.

    Raises:
        InputError: the reduced model is of another case or mesh, or the table of values is wrong.
        UsageError: the outputs are of another kind than their names say, or there are no fields.
        OutputError: the output is the case, or a file that it names; fields stand there already.
        ModelError: the model has no solution at the start values; where a stage collapses, fields
            that were asked for are written with its mechanism.
    """
    _refuse_names(to, by)
    written = () if by.values is None else read_values(by.values)
    inputs = load_inputs(path, overrides=[*overrides, NO_READINGS], text=text)
    require_stages(inputs.case)
    files = inputs.files if by.values is None else (*inputs.files, by.values)
    if to.readings is not None:
        refuse_inputs(to.readings, files)
    inputs = with_starts(inputs, written)
    model = answering_model(inputs, by)
    p = values_for(model, written)
    if draw:
        p = _drawn(model, p, np.random.default_rng([seed, 1]))  # not the numbers of the noise
    fields, field_files = None, tuple[str, ...]()
    if to.fields is not None:
        computed, fields, field_files = _with_fields(model, p, to.fields, files, force=to.force)
    elif isinstance(model, ExternalModel):
        computed = model.computed(p)  # derivatives would take more runs
    else:
        computed = model.survey(p, fields=False).computed
    readings = _readings(inputs.case, computed)
    if noise is Noise.ACCURACY:
        readings = with_noise(inputs.case, readings, seed=seed)
    notes = [*silent_gauges(model), *_undated(model, computed)]
    if isinstance(model, ReducedCaseModel) and by.reduced is not None:
        notes.append(answer_note(model, by.reduced))
    counts = replace(model.counts, evaluations=max(1, model.counts.evaluations))
    return Simulated(
        path,
        model.case,
        readings,
        files,
        "\n".join(notes),
        inputs,
        p,
        computed,
        counts,
        fields,
        field_files,
    )


_BINARY = (".h5", ".hdf5", ".hdf", ".vtkhdf")


def _refuse_names(to: Outputs, by: ComputedBy) -> None:
    """Refuse outputs whose names say another kind of file, and fields of what has none.

    Raises:
        UsageError: they do.
    """
    output, fields = to.readings, to.fields
    if output is not None and Path(output).suffix.lower() in _BINARY:
        raise UsageError(
            f"'{output}': readings are written as a table; give a name such as readings.csv, and "
            f"{Term.FIELDS} for displacements and stresses."
        )
    if fields is not None and Path(fields).suffix.lower() != ".vtkhdf":
        raise UsageError(f"'{fields}': fields are written as VTKHDF; give a name such as a.vtkhdf.")
    if fields is not None and by.reduced is not None:
        raise UsageError("A reduced model knows readings and no fields: leave it out.")


def _with_fields(
    model: ObservedModel, p: Floats, file: str, inputs: Sequence[str], *, force: bool
) -> tuple[Floats, FieldSeries, tuple[str, ...]]:
    """What the channels read (n_channels, n_stages), SI, and the states, which are written.

    Structures, shells and interfaces have files of their own, ``FILE.structures.vtkhdf`` and
    likewise. The last are the files.

    Raises:
        UsageError: the model has no mesh.
        OutputError: something stands in the place of the file, or it cannot be written.
        CollapseError: a stage collapses; the file has its mechanism, and the stages before it.
    """
    if not isinstance(model, StagedModel):
        raise UsageError("The case has no mesh, and so no fields to write.")
    with atomic_output(file, overwrite=force, inputs=inputs) as temporary:  # before the work
        try:
            survey, collapse = model.survey(p, fields=True), None
            fields, mechanism = survey.fields, None
        except CollapseError as error:
            survey, collapse, mechanism = None, error, error.motion
            fields = model.fields_up_to_collapse(p)
        assert fields is not None
        with hdf5_output(temporary) as written:
            of_stages = StageTimes.of(model.case)
            times = None if of_stages is None else of_stages.series
            write_fields(
                written,
                fields,
                mechanism=mechanism if isinstance(mechanism, Mechanism) else None,
                times=times,
            )
            add_principal_stresses(written)
    if collapse is not None:
        collapse.add(f"Its mechanism and the stages before it, for ParaView: {file}")
        raise collapse
    assert survey is not None
    files = [file]
    series = structure_series(survey.members, survey.shells, survey.interfaces)
    for kind, states in series.items():
        files.append(str(Path(file).with_suffix(f".{kind}.vtkhdf")))
        with atomic_output(files[-1], overwrite=force, inputs=inputs) as temporary:
            write_structures_vtkhdf(states, temporary, times)
    return survey.computed, fields, tuple(files)


def with_starts(inputs: Inputs, written: Sequence[WrittenValue]) -> Inputs:
    """A case that starts at given values, as far as it names their parameters.

    Args:
        inputs: the case.
        written: values of parameters; none for the case as it is.

    Raises:
        InputError: values that do not fit the parameters.
    """
    if not written:
        return inputs
    case = inputs.case
    names = {parameter.name for parameter in case.parameters}
    # coefficients of the modes of fields are known only to the model
    named = [row for row in written if not case.fields or row.name in names]
    values = values_of(named, case.parameters)
    parameters = tuple(replace(p, start=values.get(p.name, p.start)) for p in case.parameters)
    loaded = replace(inputs.loaded, case=replace(case, parameters=parameters))
    return replace(inputs, loaded=loaded)


def values_for(model: ObservedModel, written: Sequence[WrittenValue]) -> Floats:
    """The parameters (n,) of a model: values that are given, start values of the others.

    Args:
        model: of the case with these starts.
        written: values of parameters.

    Raises:
        InputError: values that do not fit the parameters.
        ModelError: they are outside the domain of the model.
    """
    p = start_values(model.case, model)
    parameters = model.case.parameters
    values = values_of(written, parameters)
    for i, parameter in enumerate(parameters):
        p[i] = values.get(parameter.name, p[i])
    return p


def answering_model(inputs: Inputs, by: ComputedBy) -> ObservedModel:
    """The model of a case; one that asks a reduced model first where one is given.

    Args:
        inputs: the case.
        by: what computes it.
    """

    def build() -> ObservedModel:
        return build_model(inputs, solver=by.solver)

    if by.reduced is None:
        return build()
    return answered(restored_for(by.reduced, inputs), inputs.case, build)


def _drawn(model: ObservedModel, p: Floats, generator: np.random.Generator) -> Floats:
    """Parameter values (n,) with the modes of all fields drawn from their priors."""
    modes = [i for i, parameter in enumerate(model.case.parameters) if parameter.field]
    if not modes:
        message = "no constant of the case varies from place to place: there is nothing to draw"
        hint = "Write 'E: {field: {mean: ..., sd: 30 %, length: 20 m}}' in a material."
        raise InputError([model.case.source.fault((), "no-field", message, hint)])
    drawn = p.copy()
    drawn[modes] = generator.standard_normal(len(modes))
    return drawn


def _readings(case: Case, computed: Floats) -> tuple[Reading, ...]:
    return tuple(
        Reading(channel.name, stage.name, float(computed[i, j]))
        for j, stage in enumerate(case.stages)
        for i, channel in enumerate(case.channels)
        if np.isfinite(computed[i, j]) and not (channel.is_zeroed and stage.name == channel.zero)
    )


def _undated(model: ObservedModel, computed: Floats) -> list[str]:
    """What is left out since the gauge drifts in time and the stage has no date, a line a stage."""
    case = model.case
    drifting = [(i, channel) for i, channel in enumerate(case.channels) if channel.drift]
    left: dict[str, list[str]] = {}
    for j, stage in enumerate(case.stages):
        for i, channel in drifting if stage.name not in case.dates else ():
            if np.isnan(computed[i, j]) and model.unreadable(channel.name, stage.name) is None:
                left.setdefault(stage.name, []).append(channel.name)
    return [
        f"not computed at '{stage}', which has no date, as the gauge drifts in time: "
        f"{named_channels(names)}"
        for stage, names in left.items()
    ]


def simulated_pairs(model: ObservedModel) -> tuple[tuple[str, str], ...]:
    """Channel and stage of each reading that is simulated, in their order.

    Args:
        model: of a case.
    """
    case = model.case
    return tuple(
        (channel.name, stage.name)
        for stage in case.stages
        for channel in case.channels
        if model.unreadable(channel.name, stage.name) is None
        and not (channel.is_zeroed and stage.name == channel.zero)
    )


def with_noise(case: Case, readings: Sequence[Reading], *, seed: int) -> tuple[Reading, ...]:
    """Readings with Gaussian noise of the accuracy of their gauges added; what they share too.

    Args:
        case: with the accuracies.
        readings: of the model.
        seed: of the noise.
    """
    generator = np.random.default_rng(seed)
    channels = {channel.name: channel for channel in case.channels}
    rows = [(channels[reading.channel], reading) for reading in readings]
    own = [c.own_sd(r) * generator.standard_normal() for c, r in rows]
    shared = error_structure(rows).columns
    noise = np.array(own, dtype=np.float64)
    noise += shared @ generator.standard_normal(shared.shape[1])
    return tuple(
        Reading(reading.channel, reading.stage, (reading.value or 0.0) + float(added))
        for reading, added in zip(readings, noise, strict=True)
    )
