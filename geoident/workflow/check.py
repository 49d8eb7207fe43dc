"""``geoident check``: everything that can be wrong, and what the case amounts to."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from geoident.errors import ModelError
from geoident.fem.solvers.threads import one_thread
from geoident.forward.external.program import ProgramModel
from geoident.forward.external.table import TableModel
from geoident.forward.gauges.placement import placements
from geoident.forward.model import StagedModel
from geoident.forward.observed import ObservedModel
from geoident.forward.openings.model import OpeningModel
from geoident.forward.reduced.stress_rows import beyond_reduction
from geoident.forward.stages import released_by
from geoident.identify.problem.methods import descend
from geoident.model.actions import FaceDistance
from geoident.model.case import VIRGIN, Case
from geoident.model.external import ConvergenceLaw, RunTable
from geoident.model.gauges import ReadingTable, named_channels
from geoident.model.in_service import SeasonalModel
from geoident.model.mesh import Mesh
from geoident.model.methods import GaussNewtonOptions, method_name
from geoident.model.parameter import Scalar, Values
from geoident.model.results.findings import sentences_of
from geoident.model.results.summary import (
    CaseSummary,
    CostEstimate,
    GaugeSummary,
    GroupSummary,
    PlaceSummary,
    ReadingSummary,
    StageSummary,
)
from geoident.model.results.surface import SurfaceTable
from geoident.model.settlement import SettlementLaw
from geoident.workflow.estimating.mistakes import mistaken_readings
from geoident.workflow.estimating.reading_patterns import (
    computed_at_start,
    size_findings,
    still_findings,
)
from geoident.workflow.estimating.setup import require_possible
from geoident.workflow.programs.logged_runs import LoggedRuns
from geoident.workflow.programs.program import executed
from geoident.workflow.running.computed import silent_gauges
from geoident.workflow.running.cost import estimate_cost, evaluations_text
from geoident.workflow.running.jobs import Inputs, build_model, load_inputs, start_values
from geoident.workflow.running.plausible import implausible_findings
from geoident.workflow.running.readings import (
    bad_notes,
    problem_of_readings,
    require_enough,
    select_readings,
    times_of,
)
from geoident.workflow.scoring.ladder import require_sound


@dataclass(frozen=True)
class Checked:
    """A case in which nothing wrong was found.

    Args:
        case: the case.
        mesh: its mesh, or None if it has none.
        summary: what it amounts to.
        files_read: paths of all that it consists of, which no output may replace.
        untrusted: it runs what nobody has permitted yet.
    """

    case: Case
    mesh: Mesh | None
    summary: CaseSummary
    files_read: tuple[str, ...]
    untrusted: bool = False


@one_thread()
def check(
    path: str, *, overrides: Sequence[str] = (), solver: str = "auto", text: str | None = None
) -> Checked:
    """Read a case and build its model.

    A model that takes less than a tenth of a second is fitted, to see whether signs, units and
    zeros of readings are right. Of one that takes less than a second, the stages are computed once,
    at the start values, to see whether readings may be in another unit; of others none after the
    virgin state.

    Args:
        path: of the case; ``-`` for stdin.
        overrides: ``KEY=VALUE`` in place of what the case says.
        solver: name of the sparse solver, or ``auto``.
        text: of the case where it stands in no file.

    Raises:
        InputError: with all faults that are found in one go.
        ModelError: the model moves freely somewhere, or the virgin ground cannot bear its stress.
    """
    inputs = load_inputs(path, overrides=overrides, text=text)
    if inputs.case.fit.ladder:
        require_sound(path, overrides, inputs.case, text)
    model = build_model(inputs, solver=solver)
    readings = select_readings(inputs.case, model)
    if inputs.case.readings:
        require_enough(inputs.case, readings)
    require_possible(model, inputs.case, inputs.case.fit.methods)
    if isinstance(model, StagedModel) and model.yields:
        next(model.at(start_values(model.case, model)).states())
    mesh = model.mesh if isinstance(model, StagedModel) else None
    runs = model.runs if isinstance(model, ProgramModel) else None
    untrusted = isinstance(runs, LoggedRuns) and not runs.is_trusted
    return Checked(inputs.case, mesh, summarize(inputs, model, readings), inputs.files, untrusted)


def summarize(inputs: Inputs, model: ObservedModel, readings: ReadingTable) -> CaseSummary:
    """What a case amounts to.

    Args:
        inputs: the case and its mesh.
        model: of the case.
        readings: which readings take part.
    """
    case = inputs.case
    staged = model if isinstance(model, StagedModel) else None
    virgin = staged.virgin_notes() if staged else ()
    solves = _right_hand_sides(model, readings)
    costs = () if solves is None else (_field_cost(model, *solves),)
    columns = None if solves is None else solves[0] / max(len(case.stages), 1)
    cost = estimate_cost(staged, solver=staged.solver_name, columns=columns) if staged else None
    units = _reading_notes(model, readings, cost)
    doubtful = (*sentences_of(implausible_findings(case)), *units, *silent_gauges(model))
    kept = _keeping_notes(staged) if case.fit.keep_reduced else ()
    notes = (*doubtful, *case.notes, *model.notes, *virgin, *costs, *kept, *bad_notes(readings))
    return CaseSummary(
        case=inputs.path,
        title=case.title,
        analysis=case.analysis.value,
        mesh=inputs.loaded.mesh_path or "",
        nodes=staged.mesh.n_places if staged else 0,
        elements=staged.mesh.n_elements if staged else 0,
        groups=_groups(case, staged) if staged else (),
        stages=_stages(case, model, readings),
        gauges=_gauges(case, readings),
        places=_places(staged) if staged else (),
        readings=_readings(case, readings),
        parameters=tuple(parameter.name for parameter in case.parameters),
        methods=(
            ("restricted likelihood",)
            if isinstance(case.elsewhere, SeasonalModel)
            else tuple(method_name(options) for options in case.fit.methods)
        ),
        used=int(np.count_nonzero(readings.used)),
        unused=tuple(Counter(readings.reason[k] for k in readings.unused).items()),
        cost=cost,
        notes=tuple(dict.fromkeys(notes)),
        when_read=case.when_read,
        resolved=inputs.loaded.resolved,
        evaluations=evaluations_text(
            case.fit.methods,
            sum(not parameter.field for parameter in case.parameters),
            yields=staged is not None and staged.yields,
        ),
        elsewhere=_elsewhere(case),
        surface=_surface(model),
        limits=_limits(case),
    )


def _elsewhere(case: Case) -> str:
    """What computes the readings, where geoident does not."""
    if case.elsewhere is None:
        return ""
    words = executed(case.elsewhere)
    if isinstance(case.elsewhere, ConvergenceLaw | SettlementLaw | SeasonalModel):
        return words
    if isinstance(case.elsewhere, RunTable):
        return f"the model is external: {words}, and response surfaces between them"
    return f"the model is external: {words}; a run gives all readings at one parameter vector"


def _surface(model: ObservedModel) -> SurfaceTable | None:
    """How well a table of runs foretells runs left out; its own errors at the start values."""
    if not isinstance(model, TableModel):
        return None
    return model.surface_table(start_values(model.case, model))


_SOON = 1.0
"""Seconds that an evaluation may take for the model to be asked what it reads."""


_AT_ONCE = 0.1
"""Seconds that an evaluation may take for the parameters to be sought."""
_STEPS = 20
"""Most steps of that search."""


def _reading_notes(
    model: ObservedModel, readings: ReadingTable, cost: CostEstimate | None
) -> tuple[str, ...]:
    """What is likely wrong with readings and priors, as far as it can be seen soon.

    Programs and functions of others are not run.
    """
    case = model.case
    if not case.parameters or not readings.used.any() or case.service is not None:
        return ()
    elsewhere = case.elsewhere is not None and not isinstance(
        case.elsewhere, ConvergenceLaw | SettlementLaw | RunTable
    )
    if elsewhere or (cost is not None and cost.seconds > _AT_ONCE):
        why = "the case is computed elsewhere" if elsewhere else f"{_seconds(cost)} an evaluation"
        later = (
            "mistakes of sign, unit, zero and name in the readings were not looked for "
            f"({why}); `geoident fit` looks for them"
        )
        soon = cost is not None and cost.seconds <= _SOON and case.elsewhere is None
        return (*(_pattern_notes(model, readings) if soon else ()), later)
    response = model.response(readings.used_pairs, times_of(readings, readings.used))
    problem = problem_of_readings(case, readings, response)
    steps = GaussNewtonOptions(max_iterations=_STEPS, starts=1)
    try:
        values = descend(problem, steps, lambda _: None).values
    except ModelError:
        return ()
    places = [values, problem.start]
    wrong = mistaken_readings(case, readings, problem, places, model, [steps])
    if wrong:
        return sentences_of(wrong.findings)
    computed = np.full(len(readings), np.nan)
    computed[readings.used] = response.readings(values)
    still = still_findings(case, replace(readings, computed=computed))
    return sentences_of(still) or _pattern_notes(model, readings)


def _seconds(cost: CostEstimate | None) -> str:
    assert cost is not None
    return f"{cost.seconds:.2g} s"


def _pattern_notes(model: ObservedModel, readings: ReadingTable) -> tuple[str, ...]:
    """Readings of which the unit is suspected at the start values."""
    if model.case.elsewhere is not None:
        return ()
    computed = computed_at_start(model.case, model, readings)
    return () if computed is None else sentences_of(size_findings(model.case, readings, computed))


def _right_hand_sides(model: ObservedModel, readings: ReadingTable) -> tuple[int, str] | None:
    """Those of an evaluation with derivatives, and the way; None where there are no fields."""
    if not isinstance(model, StagedModel) or not model.on_mesh.fields or not readings.used.any():
        return None
    pairs = readings.used_pairs
    return model.response(pairs).adjoints.columns(len(model.names))


def _keeping_notes(model: StagedModel | None) -> tuple[str, ...]:
    """Why the reduced model that a fit is to keep will not be there, or what it does not give."""
    if model is None:
        return ("no reduced model will be kept: the case is a closed form and needs none",)
    response = model.response(())
    response.record(economical=False)
    why = response.surrogate_obstacle()
    if why is not None:
        return (f"no reduced model will be kept: {why}",)
    gauges = model.gauges
    others = [
        name
        for row, name in enumerate(gauges.channels)
        if beyond_reduction(model.analysis, gauges, np.array([row])) is not None
    ]
    if not others:
        return ()
    return (
        f"the reduced model that will be kept does not give {named_channels(others)}, which "
        "read more than displacements, normal stresses and forces: what needs them is computed by "
        "the model",
    )


def _field_cost(model: ObservedModel, count: int, way: str) -> str:
    """What the modes of fields cost, in words."""
    return (
        f"with the modes of its fields an evaluation with derivatives by {len(model.names)} "
        f"parameters solves {count} right-hand sides, by {way}"
    )


def _groups(case: Case, model: StagedModel) -> tuple[GroupSummary, ...]:
    points = model.discretization.points
    volume = np.bincount(points.element, points.volume, minlength=model.mesh.n_elements)
    members = model.mesh.groups
    return tuple(
        GroupSummary(name, material, len(members[name]), float(volume[members[name]].sum()))
        for name, material in case.groups.items()
    )


def _stages(case: Case, model: ObservedModel, readings: ReadingTable) -> tuple[StageSummary, ...]:
    """Each stage once, with all its moments."""
    wholes = _wholes(case)
    used = Counter(wholes[readings.stage[k]] for k in np.flatnonzero(readings.used))
    moments = Counter(stage.whole for stage in case.stages)
    at_face = _at_face(case, model)
    return tuple(
        StageSummary(
            name=stage.whole,
            leaves=stage.excavate,
            enters=tuple(stage.install.items()),
            changes=tuple(stage.change.items()),
            loads=tuple(stage.loads),
            removed=stage.remove,
            dofs=dofs,
            used=used[stage.whole],
            base=None if base == n else case.stage_names[base],
            warmed=tuple(stage.temperature),
            water=stage.water is not None,
            drained=tuple(name for name, one in stage.drained.items() if one is not None),
            heated=tuple(stage.heat),
            closed=tuple(name for name, one in stage.drained.items() if one is None),
            built=stage.build,
            dismantled=stage.dismantle,
            stressed=tuple(name for name in stage.prestress if name not in stage.build),
            released=tuple(
                (group, at_face[stage.name] if isinstance(part, FaceDistance) else _share(part))
                for group, part in released_by(stage, case).items()
            ),
            supported=tuple(name for name, held in stage.supports.items() if held is not None),
            freed=tuple(name for name, held in stage.supports.items() if held is None),
            lasts=stage.lasts,
            moments=0 if stage.lasts is None else moments[stage.whole],
            heads=tuple(
                (name, _length(one.head, case.start))
                for name, one in stage.drained.items()
                if one is not None and one.head is not None
            ),
        )
        for n, (stage, base, dofs) in enumerate(
            zip(case.stages, model.bases[1:].tolist(), model.n_dofs[1:], strict=True)
        )
        if not stage.goes_on
    )


def _wholes(case: Case) -> dict[str, str]:
    """State to the stage of which it is the end, or a moment."""
    return {VIRGIN: VIRGIN, **{stage.name: stage.whole for stage in case.stages}}


def _at_face(case: Case, model: ObservedModel) -> dict[str, str]:
    """Stage to the part that its distance to the face releases at the start values, in words."""
    if case.face is None or not isinstance(model, StagedModel | OpeningModel):
        return {}
    return {
        state.stage: f"{100.0 * state.released:.3g} % (face {state.distance:.4g} m on)"
        for state in model.face_states(case.start)
    }


def _share(part: Scalar) -> str:
    """A part of a whole in words: per cent, or the name of a parameter."""
    return _tied(part) or f"{100.0 * part.factor:.4g} %"


def _tied(number: Scalar) -> str:
    """The parameter to which a number is tied, with its factor; empty for a given number."""
    if number.parameter is None:
        return ""
    return number.parameter if number.factor == 1.0 else f"{number.factor:g} {number.parameter}"


def _length(number: Scalar, start: Values) -> str:
    """A length in words: with the parameter to which it is tied."""
    metres, tied = f"{number.value(start):.6g} m", _tied(number)
    return f"{tied} (start {metres})" if tied else metres


def _limits(case: Case) -> tuple[tuple[str, float, float], ...]:
    """Cohesion and friction at the start of each interface that has a part of the ground's."""
    return tuple(
        (name, *one.strength(case.start))
        for name, one in case.interfaces.items()
        if one.R_inter is not None
    )


def _gauges(case: Case, readings: ReadingTable) -> tuple[GaugeSummary, ...]:
    used = Counter(readings.channel[k] for k in np.flatnonzero(readings.used))
    unused = Counter(readings.channel[k] for k in readings.unused)
    return tuple(
        GaugeSummary(
            name=channel.name,
            kind=channel.kind,
            zero=channel.zero if channel.is_zeroed else "",
            accuracy=channel.accuracy,
            used=used[channel.name],
            unused=unused[channel.name],
            dimension=channel.dimension,
            unit=channel.unit,
            estimated=channel.errors is not None and bool(channel.errors.estimated),
        )
        for channel in case.channels
    )


def _places(model: StagedModel) -> tuple[PlaceSummary, ...]:
    return tuple(
        PlaceSummary(p.channels, p.point, p.element, p.group, p.distance)
        for p in placements(model.on_mesh)
    )


def _readings(case: Case, readings: ReadingTable) -> tuple[ReadingSummary, ...]:
    """Stage by stage, with all its moments; stages without readings are left out."""
    wholes = _wholes(case)
    used: dict[str, list[str]] = {}
    for k in np.flatnonzero(readings.used):
        used.setdefault(wholes[readings.stage[k]], []).append(readings.channel[k])
    unused: dict[str, dict[str, list[str]]] = {}
    for k in readings.unused:
        reasons = unused.setdefault(wholes[readings.stage[k]], {})
        reasons.setdefault(readings.reason[k], []).append(readings.channel[k])
    moments = Counter(wholes[name] for name in set(readings.stage))
    lasting = {stage.whole for stage in case.stages if stage.lasts is not None}
    return tuple(
        ReadingSummary(
            stage,
            tuple(dict.fromkeys(used.get(stage, ()))),
            tuple(
                (why, tuple(dict.fromkeys(names))) for why, names in unused.get(stage, {}).items()
            ),
            moments[stage] if stage in lasting else 0,
        )
        for stage in dict.fromkeys(wholes.values())
        if stage in used or stage in unused
    )
