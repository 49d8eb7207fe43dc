"""What a reduced model is made of: moduli, loads and histories as sums of few (theory 14).

`AffineForm` says what depends on the parameters, and is all that a reduced model needs once it is
made; `AffineAnalysis` adds the analysis and the ground that a form was found of.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from geoident.forward.affine import trial_points
from geoident.forward.analysis.analysis import StagedAnalysis
from geoident.forward.checks import inadmissible_numbers
from geoident.forward.gauges.observation import PlacedGauges
from geoident.forward.reduced.loads import LoadForm, load_form
from geoident.forward.reduced.moduli import Span, material_moduli, rigidity_moduli, span_of
from geoident.forward.reduced.points import AnalysisPoints
from geoident.forward.reduced.stress_rows import StressRows, stress_rows
from geoident.forward.reduced.zones import Zone, member_zones, rigidity_name
from geoident.model.arrays import Floats, Ints
from geoident.model.parameter import Values

_DRAWS = 24
"""Parameter vectors at which moduli and loads are looked at, beside three for each parameter."""


@dataclass(frozen=True, eq=False)
class AffineFactors:
    """Moduli and loads at parameter vectors (b).

    Args:
        moduli: material to its coordinates (b, r).
        slopes: likewise (b, r, n).
        loads: psi (b, r).
        load_slopes: (b, r, n).
    """

    moduli: Mapping[str, Floats]
    slopes: Mapping[str, Floats]
    loads: Floats
    load_slopes: Floats


@dataclass(frozen=True, eq=False)
class AffineForm:
    """Moduli and loads as sums of few fixed ones.

    Args:
        names: of the n parameters.
        spans: moduli of every material, rigidities of structures.
        loads: in-situ stress and forces.
    """

    names: tuple[str, ...]
    spans: Mapping[str, Span]
    loads: LoadForm

    def at(self, values: Floats) -> AffineFactors:
        """Moduli and loads at parameter vectors (b, n).

        Raises:
            ValueError: moduli leave the span of those that were seen.
        """
        coordinates = {name: span.coordinates(values) for name, span in self.spans.items()}
        psi, slopes = self.loads.coordinates(values)
        return AffineFactors(
            {name: c for name, (c, _) in coordinates.items()},
            {name: dc for name, (_, dc) in coordinates.items()},
            psi,
            slopes,
        )


@dataclass(frozen=True, eq=False)
class AffineAnalysis:
    """An analysis whose moduli and loads have a form, up to a state.

    Args:
        analysis: of the case.
        form: of its moduli and loads.
        zones: of every state.
        points: of the ground, and members.
        rows: gauges that read stresses and forces.
    """

    analysis: StagedAnalysis
    form: AffineForm
    zones: tuple[tuple[Zone, ...], ...]
    points: AnalysisPoints
    rows: StressRows

    def jacked(self, state: int) -> Ints:
        """Members (k,) whose force is given in a state."""
        given = self.analysis.sequence.states[state]
        parts = self.analysis.systems.structures.parts
        rows = [np.arange(p.rows.start, p.rows.stop) for p in parts if p.stressed_in(given)]
        return self.points.n_ground + np.concatenate([np.empty(0, np.int64), *rows])


def affine_analysis(
    analysis: StagedAnalysis, ground: Sequence[Sequence[Zone]], last: int, gauges: PlacedGauges
) -> AffineAnalysis | None:
    """The analysis of a case to its last state wanted; None where its loads have no form.

    Args:
        analysis: of the case.
        ground: zones of the ground in every state (`zones_of`).
        last: the last state wanted.
        gauges: those of the case, on its mesh.
    """
    names = tuple(q.name for q in analysis.case.parameters)
    samples = _samples(analysis, names)
    loads = load_form(analysis, names, samples, last)
    if loads is None:
        return None
    s = analysis.systems.discretization.points.n_strain
    moduli = {
        name: material_moduli(analysis.case.materials[name], names, s)
        for name in analysis.sequence.materials
    }
    for part in analysis.systems.structures.parts:
        for number in range(part.members.n_rigidities):
            name = rigidity_name(part.name, number)
            moduli[name] = rigidity_moduli(part.structure, names, s, number=number)
    spans = {name: span_of(name, E, samples) for name, E in moduli.items()}
    points = AnalysisPoints(analysis.systems)
    every = zip(ground, member_zones(analysis, points), strict=True)
    zones = tuple((*own, *members) for own, members in every)
    form, rows = AffineForm(names, spans, loads), stress_rows(analysis, gauges)
    return AffineAnalysis(analysis, form, zones[: last + 1], points, rows)


def _samples(analysis: StagedAnalysis, names: tuple[str, ...]) -> Floats:
    """Parameter vectors (b, n) all over the domain; the last ones are its two ends.

    Where a vector is outside the domain of the model it is drawn towards the start.
    """
    parameters = analysis.case.parameters

    def admissible(values: Values) -> bool:
        return inadmissible_numbers(analysis.case, analysis.sequence, values) is None

    points = trial_points(parameters, admissible)
    samples = [np.array([point.values[name] for name in names]) for point in points]
    start = np.array([q.start for q in parameters])
    bounds = np.array([(q.lower, q.upper) for q in parameters]).T
    inside = [np.min(samples, axis=0), np.max(samples, axis=0)]
    low, high = np.where(np.isfinite(bounds), bounds, inside)
    parts = np.random.default_rng(0).random((_DRAWS + 3 * len(start), len(start)))
    for part in (*parts, np.zeros(len(start)), np.ones(len(start))):
        p = low + (high - low) * part
        for _ in range(20):
            if admissible(dict(zip(names, map(float, p), strict=True))):
                break
            p = 0.5 * (p + start)
        samples.append(p)
    return np.array(samples)
