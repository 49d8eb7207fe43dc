"""All sections as one problem of least squares (theory 15).

The unknowns of all sections together are, in this order,

    shared parameters            one value for all sections
    constants of the laws        b
    of each section              its own parameters, and those that scatter about a law

With the scatter tau_k of a law given, a parameter z_sk of section s that follows the law mu_k adds
one row to the readings of all sections,

    (x(z_sk) - x(mu_k(c_s; b))) / tau_k

where x is the scale on which the parameter is identified (its logarithm, or its value by its
reference). So the bounds of z_sk hold, and what minimises phi minimises theory [20] of all sections
together. Where tau_k is zero there is no z_sk: the parameter is mu_k(c_s; b) itself.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np
import scipy.sparse as sp

from geoident.errors import ModelError
from geoident.identify.problem.errors import SharedErrors
from geoident.identify.problem.problem import Problem
from geoident.identify.problem.scaling import Scaling
from geoident.model.arrays import Bools, Floats, Ints
from geoident.model.parameter import Parameter
from geoident.model.project.project import ParameterLaw
from geoident.model.results.costs import Counts
from geoident.units import in_unit, shown_unit

WIDEST = 10.0
"""Range of a scale without finite bounds: ten references, or a factor e^10."""


@dataclass(frozen=True)
class SectionReadings:
    """What is known of a section before all are put together.

    Args:
        name: of the section.
        parameters: the n of its case.
        covariates: what is known of it, SI.
        measured: (g,) readings, SI.
        sd: (g,) standard deviation of what each has by itself, SI.
        shared: what they share of their errors, or None.
    """

    name: str
    parameters: tuple[Parameter, ...]
    covariates: Mapping[str, float]
    measured: Floats
    sd: Floats
    shared: SharedErrors | None = None

    def problem(self, models: SectionModels, number: int) -> Problem:
        """The readings of this section alone.

        Args:
            models: of all sections.
            number: of this one.
        """
        response = _OneSection(models, number, tuple(q.name for q in self.parameters))
        return Problem(response, self.measured, self.sd, self.parameters, shared=self.shared)


class SectionModels(Protocol):
    """The models of all sections, which may be asked at once."""

    @property
    def counts(self) -> Counts:
        """Costs so far."""

    def evaluate(self, points: Mapping[int, Floats]) -> Mapping[int, tuple[Floats, Floats]]:
        """Readings (g,) of some sections and their exact Jacobians (g, n).

        Args:
            points: number of a section to its parameters (n,), SI.

        Raises:
            ModelError: one of them has no solution.
        """

    def sharpen(self, points: Mapping[int, Floats]) -> bool:
        """Make Jacobians that are differences as good as they can be; whether any were not.

        Args:
            points: number of a section to its parameters (n,), SI.
        """


@dataclass(frozen=True)
class _OneSection:
    """The response of one section."""

    models: SectionModels
    number: int
    names: tuple[str, ...]

    @property
    def counts(self) -> Counts:
        """Costs so far, of all sections."""
        return self.models.counts

    def admissible(self, p: Floats) -> str | None:
        """Why p (n,) is outside the domain; only the model itself knows."""
        return None

    def readings(self, p: Floats) -> Floats:
        """v(p), (g,)."""
        return self.evaluate(p)[0]

    def evaluate(self, p: Floats) -> tuple[Floats, Floats]:
        """v(p), (g,), and its Jacobian, (g, n)."""
        return self.models.evaluate({self.number: p})[self.number]

    def sharpen(self, p: Floats) -> bool:
        """Make the Jacobian at p (n,) as good as it can be; whether it was not before."""
        return self.models.sharpen({self.number: p})


class Arrangement:
    """Which unknown of all sections is which parameter of which section.

    Args:
        sections: S of them; parameters that are shared or follow a law have one scale in all.
        shared: names of the shared parameters.
        laws: K laws.
        scattering: (K,) the sections scatter about the law.

    Attributes:
        unknowns: the N unknowns.
        n_common: number of shared parameters and constants of laws, which are the first.
        laws: the laws.
        scattering: (K,) as given.
        sections: the sections, with one scale in all.
        scalings: S scales of their parameters.
        templates: the common parameters by name.
        reference: (K,) SI by the scale of a law's parameter; 1 of one on a logarithmic scale.
        log: (K,) the scale of a law's parameter is its logarithm.
        largest: (K,) standard deviation, on its scale, of a parameter of which only the bounds are
            known.
    """

    def __init__(
        self,
        sections: Sequence[SectionReadings],
        shared: Sequence[str],
        laws: Sequence[ParameterLaw],
        scattering: Bools,
    ) -> None:
        self.laws = tuple(laws)
        self.shared = tuple(shared)
        self.scattering = scattering
        common = _templates(sections, [*shared, *(law.parameter for law in laws)])
        self.templates = common
        self.sections = tuple(_on_one_scale(section, common) for section in sections)
        self.scalings = tuple(Scaling(section.parameters) for section in self.sections)
        self._law_of = {law.parameter: k for k, law in enumerate(self.laws)}
        unknowns = [replace(common[name]) for name in shared]
        self._constants: list[Ints] = []
        for law in self.laws:
            first = len(unknowns)
            unknowns += law.constants
            self._constants.append(np.arange(first, len(unknowns)))
        self.n_common = len(unknowns)
        self._places: list[Ints] = []  # of the parameters of a section; -1 for those of a law
        for section in self.sections:
            places = []
            for q in section.parameters:
                k = self._law_of.get(q.name)
                if q.name in self.shared:
                    places.append(self.shared.index(q.name))
                elif k is not None and not scattering[k]:
                    places.append(-1)
                else:
                    places.append(len(unknowns))
                    prior = q.prior if k is None else None  # the law takes its place
                    unknowns.append(
                        replace(q, name=unknown_name(q.name, section.name), prior=prior)
                    )
            self._places.append(np.array(places, dtype=np.int64))
        self.unknowns: tuple[Parameter, ...] = tuple(unknowns)
        references = [Scaling([common[law.parameter]]).reference[0] for law in self.laws]
        self.reference = np.array(references, dtype=np.float64)
        self.log = np.array([common[law.parameter].scale == "log" for law in self.laws], np.bool_)
        self.largest = np.array([of_bounds(common[law.parameter]) for law in self.laws], np.float64)

    def place(self, number: int, parameter: int) -> int:
        """The unknown that is a parameter of a section; -1 where a law gives it."""
        return int(self._places[number][parameter])

    def law_of(self, name: str) -> int | None:
        """The number of the law of a parameter, or None."""
        return self._law_of.get(name)

    def is_common(self, name: str) -> bool:
        """Whether a parameter is shared, or follows a law."""
        return name in self.shared or name in self._law_of

    def scaled(self, section: SectionReadings) -> SectionReadings:
        """A further section on the scales of these."""
        return _on_one_scale(section, self.templates)

    def further_point(self, section: SectionReadings, values: Floats) -> Floats:
        """The parameters (n,) to be expected of a section, SI: its own at their priors.

        Args:
            section: with its parameters and covariates.
            values: (n_common,) at least, the unknowns, SI.
        """
        found = []
        for q in section.parameters:
            k = self._law_of.get(q.name)
            if q.name in self.shared:
                p = float(values[self.shared.index(q.name)])
            elif k is not None:
                p = self.law_value(k, self.law(k, section.covariates, values)[0])
            else:
                p = q.start if q.prior is None else q.prior.mean
            found.append(min(max(p, q.lower), q.upper))
        return np.array(found, dtype=np.float64)

    def constants_of(self, k: int) -> Ints:
        """The unknowns (c,) that are the constants of a law."""
        return self._constants[k]

    def law(self, k: int, covariates: Mapping[str, float], values: Floats) -> tuple[float, Floats]:
        """What a law says, x(mu), and its derivatives (c,) by its constants, SI.

        Args:
            k: number of the law.
            covariates: of a section.
            values: (N,) or (n_common,) unknowns, SI.

        Raises:
            ModelError: it has no value there.
        """
        mu, slopes = self.laws[k].at(covariates, values[self._constants[k]])
        if not np.isfinite(mu) or (self.log[k] and mu <= 0.0):
            name = self.laws[k].parameter
            raise ModelError(f"The law of {name} gives {mu:g}, which is no value of it.")
        if self.log[k]:
            return float(np.log(mu)), slopes / mu
        return float(mu / self.reference[k]), slopes / self.reference[k]

    def law_value(self, k: int, x: float) -> float:
        """A value of the parameter of a law, SI, from its scale."""
        return float(np.exp(x)) if self.log[k] else float(x * self.reference[k])

    def point(self, number: int, values: Floats) -> tuple[Floats, Floats]:
        """The parameters (n,) of a section, SI, and their derivatives (n, N) by all unknowns.

        Args:
            number: of the section.
            values: (N,) all unknowns, SI.

        Raises:
            ModelError: a law has no value within the bounds of its parameter.
        """
        section, places = self.sections[number], self._places[number]
        p = np.empty(len(places))
        slopes = np.zeros((len(places), len(self.unknowns)))
        for i, (q, place) in enumerate(zip(section.parameters, places, strict=True)):
            if place >= 0:
                p[i], slopes[i, place] = values[place], 1.0
                continue
            k = self._law_of[q.name]
            x, by = self.law(k, section.covariates, values)
            p[i] = self.law_value(k, x)
            if not q.lower * (1 - 1e-12) <= p[i] <= q.upper * (1 + 1e-12):
                found, low, high = (
                    in_unit(x, q.unit, q.dimension) for x in (float(p[i]), q.lower, q.upper)
                )
                unit = f" {shown_unit(q.unit, q.dimension)}".rstrip()
                raise ModelError(
                    f"The law of {q.name} gives {found:.4g}{unit} for {section.name}, outside its "
                    f"bounds {low:.4g}{unit} to {high:.4g}{unit}."
                )
            slopes[i, self._constants[k]] = by * (p[i] if self.log[k] else self.reference[k])
        return p, slopes

    def joined(self, common: Floats, points: Sequence[Floats]) -> Floats:
        """All unknowns (N,), SI, from what is common and the parameters of the sections.

        Args:
            common: (n_common,) shared parameters and constants of laws, SI.
            points: of each section its parameters (n,), SI.
        """
        values = np.empty(len(self.unknowns))
        values[: self.n_common] = common
        for places, point in zip(self._places, points, strict=True):
            own = places >= self.n_common
            values[places[own]] = point[own]
        return values

    def law_rows(self, values: Floats) -> tuple[Floats, Floats]:
        """x(z) - x(mu) of all sections and scattering laws, (m,), and its derivatives (m, N), SI.

        Args:
            values: (N,) all unknowns, SI.
        """
        gaps, rows = [], []
        for number, section in enumerate(self.sections):
            for i, q in enumerate(section.parameters):
                k = self._law_of.get(q.name)
                if k is None or not self.scattering[k]:
                    continue
                place, row = self._places[number][i], np.zeros(len(self.unknowns))
                x, by = self.law(k, section.covariates, values)
                z = values[place]
                gaps.append((np.log(z) if self.log[k] else z / self.reference[k]) - x)
                row[place] = 1.0 / (z if self.log[k] else self.reference[k])
                row[self._constants[k]] = -by
                rows.append(row)
        return np.array(gaps), np.array(rows).reshape(-1, len(self.unknowns))

    def row_laws(self) -> Ints:
        """The number of the law of each of the rows (m,) of `law_rows`."""
        found = [
            self._law_of[q.name]
            for section in self.sections
            for q in section.parameters
            if q.name in self._law_of and self.scattering[self._law_of[q.name]]
        ]
        return np.array(found, dtype=np.int64)

    def problem(self, models: SectionModels, tau: Floats) -> Problem:
        """All sections as one problem.

        Args:
            models: of the sections.
            tau: (K,) scatter about the laws, on their scales.
        """
        laws = self.row_laws()
        measured = [section.measured for section in self.sections]
        sd = [section.sd for section in self.sections]
        blocks = [_columns(section) for section in self.sections]
        blocks.append(sp.csr_array((len(laws), 0)))
        columns = sp.csr_array(sp.block_diag(blocks, format="csr"))
        shared = SharedErrors(columns) if columns.shape[1] else None
        return Problem(
            JointResponse(self, models),
            np.concatenate([*measured, np.zeros(len(laws))]),
            np.concatenate([*sd, tau[laws]]),
            self.unknowns,
            shared=shared,
        )


class JointResponse:
    """The readings of all sections, and the rows of the laws, as one response.

    Args:
        arrangement: of the unknowns.
        models: of the sections.
    """

    def __init__(self, arrangement: Arrangement, models: SectionModels) -> None:
        self._arrangement, self._models = arrangement, models

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the N unknowns."""
        return tuple(q.name for q in self._arrangement.unknowns)

    @property
    def counts(self) -> Counts:
        """Costs so far."""
        return self._models.counts

    def admissible(self, p: Floats) -> str | None:
        """Why p (N,) is outside the domain, or None if it is inside."""
        try:
            self._points(p)
            self._arrangement.law_rows(p)
        except ModelError as error:
            return str(error)
        return None

    def readings(self, p: Floats) -> Floats:
        """v(p), (g,), of all sections, then the rows of the laws."""
        return self.evaluate(p)[0]

    def evaluate(self, p: Floats) -> tuple[Floats, Floats]:
        """v(p), (g,), and its exact Jacobian, (g, N)."""
        points = self._points(p)
        found = self._models.evaluate({s: own for s, (own, _) in points.items()})
        gaps, rows = self._arrangement.law_rows(p)
        v = [found[s][0] for s in points]
        J = [found[s][1] @ slopes for s, (_, slopes) in points.items()]
        return np.concatenate([*v, gaps]), np.concatenate([*J, rows])

    def sharpen(self, p: Floats) -> bool:
        """Make the Jacobians at p (N,) as good as they can be; whether they were not before."""
        return self._models.sharpen({s: own for s, (own, _) in self._points(p).items()})

    def _points(self, p: Floats) -> dict[int, tuple[Floats, Floats]]:
        made = self._arrangement
        return {s: made.point(s, p) for s in range(len(made.sections))}


def of_bounds(parameter: Parameter) -> float:
    """Standard deviation, on its scale, of a parameter of which only its bounds are known."""
    scaling = Scaling([parameter])
    width = float(scaling.upper[0] - scaling.lower[0])
    return (width if np.isfinite(width) else WIDEST) / math.sqrt(12.0)


def unknown_name(parameter: str, section: str) -> str:
    """What a parameter of one section is called among the unknowns of all.

    >>> unknown_name("E_rock", "km 1.2")
    'E_rock of km 1.2'
    """
    return f"{parameter} of {section}"


def _columns(section: SectionReadings) -> sp.csr_array:
    if section.shared is None:
        return sp.csr_array((len(section.measured), 0))
    return section.shared.columns


def _templates(
    sections: Sequence[SectionReadings], names: Sequence[str]
) -> Mapping[str, Parameter]:
    """The parameters of these names as the first section has them."""
    known = {q.name: q for q in sections[0].parameters}
    return {name: known[name] for name in names}


def _on_one_scale(section: SectionReadings, common: Mapping[str, Parameter]) -> SectionReadings:
    """A section whose common parameters start where those of the first do: one scale for all."""
    own = tuple(
        replace(q, start=common[q.name].start) if q.name in common else q
        for q in section.parameters
    )
    return replace(section, parameters=own)
