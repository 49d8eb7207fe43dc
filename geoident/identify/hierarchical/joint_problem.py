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
from geoident.identify.assessment.spectrum import admissible_ranges
from geoident.identify.problem.problem import Problem
from geoident.identify.problem.scaling import Scaling
from geoident.identify.problem.shared_errors import SharedErrors
from geoident.model.arrays import Bools, Floats, Ints
from geoident.model.parameter import Parameter
from geoident.model.project.project import ParameterLaw
from geoident.model.results.costs import Counts
from geoident.units import in_unit, shown_unit

_ON_BOUND = 1e-12
"""A law may leave the bounds of its parameter by this part of them: the rounding of a formula."""


@dataclass(frozen=True)
class SectionReadings:
    """A section with its readings.

    Args:
        name: of the section.
        parameters: the n of its case.
        covariates: what is known of it, SI.
        measured: (g,) readings, SI.
        sd: (g,) standard deviation of each reading's own error, SI.
        shared: errors that readings share, or None.
    """

    name: str
    parameters: tuple[Parameter, ...]
    covariates: Mapping[str, float]
    measured: Floats
    sd: Floats
    shared: SharedErrors | None = None


class SectionModels(Protocol):
    """The models of all sections, which may be computed at once."""

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
        """Improve Jacobians that are differences; returns whether any could be improved.

        Args:
            points: number of a section to its parameters (n,), SI.
        """


class JointUnknowns:
    """The unknowns of all sections, and how the parameters of each section follow from them.

    Args:
        sections: S of them; parameters that are shared or follow a law have one scale in all.
        shared: names of the shared parameters.
        laws: K laws.
        scattering: (K,) the sections scatter about the law.

    Attributes:
        unknowns: the N unknowns.
        n_common: number F of shared parameters and constants of laws, which come first.
        sections: the sections, with one scale in all.
        templates: shared parameters and those of laws by name.
        law_scaling: scale of the parameters of the K laws.
        largest: (K,) standard deviation, on its scale, of a parameter of which only the bounds are
            known.

    >>> from geoident.model.parameter import Parameter
    >>> from geoident.model.project.formulas import LawTerm
    >>> from geoident.model.project.project import ParameterLaw, Scatter
    >>> E, nu = Parameter("E", 5e9, 1e9, 9e9), Parameter("nu", 0.2, 0.1, 0.4)
    >>> law = ParameterLaw("E", "m", LawTerm("name", name="m"),
    ...                    (Parameter("m", 4e9, 1e9, 9e9),), Scatter("estimate", 0.0))
    >>> none = np.zeros(0)
    >>> sections = [SectionReadings(f"km {s}", (E, nu), {}, none, none) for s in (1, 2)]
    >>> joint = JointUnknowns(sections, ["nu"], [law], np.array([True]))
    >>> [q.name for q in joint.unknowns]
    ['nu', 'm', 'E of km 1', 'E of km 2']
    """

    def __init__(
        self,
        sections: Sequence[SectionReadings],
        shared: Sequence[str],
        laws: Sequence[ParameterLaw],
        scattering: Bools,
    ) -> None:
        self.laws, self.shared, self.scattering = tuple(laws), tuple(shared), scattering
        self._law_numbers = {law.parameter: k for k, law in enumerate(laws)}
        first = {q.name: q for q in sections[0].parameters}
        self.templates = {name: first[name] for name in (*shared, *self._law_numbers)}
        self.sections = tuple(self.on_common_scale(section) for section in sections)
        unknowns = [self.templates[name] for name in shared]
        self._constants: list[Ints] = []  # of each law, which unknowns are its constants
        for law in laws:
            self._constants.append(np.arange(len(law.constants)) + len(unknowns))
            unknowns += law.constants
        self.n_common = len(unknowns)
        self._unknown_of: list[Ints] = []  # of each parameter of a section; -1: given by a law
        self._scattered: list[list[tuple[int, int]]] = []  # of each: its parameter, the unknown
        for section in self.sections:
            numbers, scattered = [], []
            for i, q in enumerate(section.parameters):
                k = self.law_of(q.name)
                if q.name in shared:
                    numbers.append(self.shared.index(q.name))
                elif k is not None and not scattering[k]:
                    numbers.append(-1)
                else:
                    if k is not None:
                        scattered.append((i, len(unknowns)))
                    numbers.append(len(unknowns))
                    prior = q.prior if k is None else None  # the law takes the prior's place
                    unknowns.append(replace(q, name=f"{q.name} of {section.name}", prior=prior))
            self._unknown_of.append(np.array(numbers, dtype=np.int64))
            self._scattered.append(scattered)
        self.unknowns: tuple[Parameter, ...] = tuple(unknowns)
        of_laws = [self.templates[law.parameter] for law in laws]
        self.law_scaling = Scaling(of_laws)
        self.largest = np.array([sd_of_bounds(q) for q in of_laws], dtype=np.float64)

    def law_of(self, name: str) -> int | None:
        """The number of the law of a parameter, or None."""
        return self._law_numbers.get(name)

    def on_common_scale(self, section: SectionReadings) -> SectionReadings:
        """A section whose common parameters start where those of the first do: one scale in all."""
        parameters = tuple(
            replace(q, start=self.templates[q.name].start) if q.name in self.templates else q
            for q in section.parameters
        )
        return replace(section, parameters=parameters)

    def at_laws(self, covariates: Mapping[str, float], values: Floats) -> tuple[Floats, Floats]:
        """The values mu (K,) of the laws, SI, and their derivatives (K, F) by what is common.

        Args:
            covariates: of a section.
            values: (F,) at least, the unknowns, SI.

        Raises:
            ModelError: a law has no value there.
        """
        mu, slopes = np.zeros(len(self.laws)), np.zeros((len(self.laws), self.n_common))
        for k, (law, constants) in enumerate(zip(self.laws, self._constants, strict=True)):
            mu[k], slopes[k, constants] = law.at(covariates, values[constants])
            if not np.isfinite(mu[k]) or (self.law_scaling.log[k] and mu[k] <= 0.0):
                raise ModelError(
                    f"The law of {law.parameter} gives {mu[k]:g}, outside its admissible range."
                )
        return mu, slopes

    def expected_point(self, section: SectionReadings, values: Floats) -> Floats:
        """The parameters (n,) expected of a section, SI: its own at their priors or starts.

        Args:
            section: with its parameters and covariates.
            values: (F,) at least, the unknowns, SI.
        """
        mu, _ = self.at_laws(section.covariates, values)
        expected = []
        for q in section.parameters:
            k = self.law_of(q.name)
            if q.name in self.shared:
                p = float(values[self.shared.index(q.name)])
            elif k is not None:
                p = float(mu[k])
            else:
                p = q.start if q.prior is None else q.prior.mean
            expected.append(min(max(p, q.lower), q.upper))
        return np.array(expected, dtype=np.float64)

    def point(self, s: int, values: Floats) -> tuple[Floats, Floats]:
        """The parameters (n,) of a section, SI, and their derivatives (n, N) by all unknowns.

        Args:
            s: number of the section.
            values: (N,) all unknowns, SI.

        Raises:
            ModelError: a law has no value within the bounds of its parameter.
        """
        section, numbers = self.sections[s], self._unknown_of[s]
        mu, by_common = self.at_laws(section.covariates, values)
        p, slopes = values[numbers], np.zeros((len(numbers), len(self.unknowns)))
        for i, (q, number) in enumerate(zip(section.parameters, numbers.tolist(), strict=True)):
            if number >= 0:
                slopes[i, number] = 1.0
                continue
            k = self._law_numbers[q.name]
            p[i], slopes[i, : self.n_common] = mu[k], by_common[k]
            if not q.lower * (1 - _ON_BOUND) <= p[i] <= q.upper * (1 + _ON_BOUND):
                value, low, high = (
                    f"{in_unit(float(x), q.unit, q.dimension):.4g} "
                    f"{shown_unit(q.unit, q.dimension)}".rstrip()
                    for x in (p[i], q.lower, q.upper)
                )
                raise ModelError(
                    f"The law of {q.name} gives {value} for {section.name}, outside its bounds "
                    f"{low} to {high}."
                )
        return p, slopes

    def points(self, values: Floats) -> dict[int, Floats]:
        """The parameters (n,) of all sections by their numbers, SI."""
        return {s: self.point(s, values)[0] for s in range(len(self.sections))}

    def joined(self, common: Floats, points: Sequence[Floats]) -> Floats:
        """All unknowns (N,), SI, from the common ones (F,) and the parameters of each section."""
        values = np.empty(len(self.unknowns))
        values[: self.n_common] = common
        for numbers, point in zip(self._unknown_of, points, strict=True):
            own = numbers >= self.n_common
            values[numbers[own]] = point[own]
        return values

    def law_rows(self, values: Floats) -> tuple[Floats, Floats]:
        """x(z) - x(mu) of all that scatters, (m,), and its derivatives (m, N), SI.

        Args:
            values: (N,) all unknowns, SI.
        """
        F = self.n_common
        dp_dx = Scaling(self.unknowns[:F]).dp_dx(values[:F])
        deviations, rows = list[float](), list[Floats]()
        for s, section in enumerate(self.sections):
            p, _ = self.point(s, values)
            Phi, _, deviation = self.by_common(section, p, values)
            for i, number in self._scattered[s]:
                row = np.zeros(len(values))
                row[:F], row[number] = (
                    -Phi[i] / dp_dx,
                    1.0 / Scaling(section.parameters).dp_dx(p)[i],
                )
                deviations.append(deviation[i])
                rows.append(row)
        return np.array(deviations), np.array(rows).reshape(-1, len(values))

    def by_common(
        self, section: SectionReadings, p: Floats, values: Floats
    ) -> tuple[Floats, Floats, Floats]:
        """How the parameters of a section follow from the common unknowns, all on their scales.

        Args:
            section: one of the sections, or a further one.
            p: (n,) its parameters, SI.
            values: (F,) at least, the unknowns, SI.

        Returns:
            Phi (n, F), Z (n, K): which parameter follows which law, and the deviation of x from
            its law (n,).
        """
        n, F = len(p), self.n_common
        dp_dx = Scaling(self.unknowns[:F]).dp_dx(values[:F])
        mu, slopes = self.at_laws(section.covariates, values)
        Phi, Z, deviation = np.zeros((n, F)), np.zeros((n, len(self.laws))), np.zeros(n)
        for i, q in enumerate(section.parameters):
            k = self.law_of(q.name)
            if k is not None:
                Z[i, k], Phi[i] = 1.0, slopes[k] * dp_dx / self.law_scaling.dp_dx(mu)[k]
                if self.law_scaling.log[k]:
                    deviation[i] = np.log(p[i]) - np.log(mu[k])
                else:
                    deviation[i] = (p[i] - mu[k]) / self.law_scaling.reference[k]
            elif q.name in self.shared:
                Phi[i, self.shared.index(q.name)] = 1.0
        return Phi, Z, deviation

    def problem(self, models: SectionModels, tau: Floats) -> Problem:
        """All sections as one problem.

        Args:
            models: of the sections.
            tau: (K,) scatter about the laws, on their scales.
        """
        laws = [
            self._law_numbers[section.parameters[i].name]
            for section, scattered in zip(self.sections, self._scattered, strict=True)
            for i, _ in scattered
        ]
        blocks = [
            sp.csr_array((len(section.sd), 0)) if section.shared is None else section.shared.columns
            for section in self.sections
        ]
        columns = sp.block_diag([*blocks, sp.csr_array((len(laws), 0))], format="csr")
        return Problem(
            JointResponse(self, models),
            np.concatenate([*(section.measured for section in self.sections), np.zeros(len(laws))]),
            np.concatenate([*(section.sd for section in self.sections), tau[laws]]),
            self.unknowns,
            shared=SharedErrors(sp.csr_array(columns)) if columns.shape[1] else None,
        )


@dataclass(frozen=True)
class JointResponse:
    """The readings of all sections, and the rows of the laws, as one response.

    Args:
        joint: the unknowns.
        models: of the sections.
    """

    joint: JointUnknowns
    models: SectionModels

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the N unknowns."""
        return tuple(q.name for q in self.joint.unknowns)

    @property
    def counts(self) -> Counts:
        """Costs so far."""
        return self.models.counts

    def admissible(self, p: Floats) -> str | None:
        """Why p (N,) is outside the domain, or None if it is inside."""
        try:
            self.joint.points(p)
            self.joint.law_rows(p)
        except ModelError as error:
            return str(error)
        return None

    def readings(self, p: Floats) -> Floats:
        """v(p), (g,), of all sections, then the rows of the laws."""
        return self.evaluate(p)[0]

    def evaluate(self, p: Floats) -> tuple[Floats, Floats]:
        """v(p), (g,), and its exact Jacobian, (g, N)."""
        sections = range(len(self.joint.sections))
        points, slopes = zip(*(self.joint.point(s, p) for s in sections), strict=True)
        answers = self.models.evaluate(dict(enumerate(points)))
        deviations, rows = self.joint.law_rows(p)
        v = [answers[s][0] for s in sections]
        J = [answers[s][1] @ slopes[s] for s in sections]
        return np.concatenate([*v, deviations]), np.concatenate([*J, rows])

    def sharpen(self, p: Floats) -> bool:
        """Improve the Jacobians at p (N,); returns whether any could be improved."""
        return self.models.sharpen(self.joint.points(p))


def sd_of_bounds(parameter: Parameter) -> float:
    """Standard deviation, on its scale, of a parameter that is uniform between its bounds."""
    return float(admissible_ranges(Scaling([parameter]))[0]) / math.sqrt(12.0)
