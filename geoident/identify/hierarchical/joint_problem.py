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
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Protocol

import numpy as np
import scipy.sparse as sp

from geoident.errors import ModelError
from geoident.identify.problem.errors import Covariance, SharedErrors
from geoident.identify.problem.problem import Problem
from geoident.identify.problem.scaling import Scaling
from geoident.model.arrays import Bools, Floats, Ints
from geoident.model.parameter import Parameter
from geoident.model.project.project import ParameterLaw
from geoident.model.results.costs import Counts
from geoident.units import in_unit, shown_unit

UNBOUNDED_RANGE = 10.0
"""Range of a scale without finite bounds: ten references, or a factor e^10."""

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

    @cached_property
    def shared_columns(self) -> sp.csr_array:
        """B (g, K), the sizes of the shared errors, SI; without columns where there are none."""
        return sp.csr_array((len(self.sd), 0)) if self.shared is None else self.shared.columns

    def whiten(self, values: Floats) -> Floats:
        """Values (g,) or (g, k) of the readings, SI, in independent standard deviations."""
        if self.shared is None:
            return np.asarray((values.T / self.sd).T)
        return Covariance(self.sd, self.shared).whiten(values)


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
        scalings: S scales of their parameters.
        templates: shared parameters and those of laws by name.
        reference: (K,) SI by the scale of a law's parameter; 1 of one on a logarithmic scale.
        log: (K,) the scale of a law's parameter is its logarithm.
        largest: (K,) standard deviation, on its scale, of a parameter of which only the bounds are
            known.
        constants: of each law, the numbers (c,) of the unknowns that are its constants.

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
        self.scalings = tuple(Scaling(section.parameters) for section in self.sections)
        unknowns = [self.templates[name] for name in shared]
        self.constants: list[Ints] = []
        for law in laws:
            self.constants.append(np.arange(len(law.constants)) + len(unknowns))
            unknowns += law.constants
        self.n_common = len(unknowns)
        self._unknown_of: list[Ints] = []  # of each parameter of a section; -1: given by a law
        for section in self.sections:
            numbers = []
            for q in section.parameters:
                k = self.law_of(q.name)
                if q.name in shared:
                    numbers.append(self.shared.index(q.name))
                elif k is not None and not scattering[k]:
                    numbers.append(-1)
                else:
                    numbers.append(len(unknowns))
                    prior = q.prior if k is None else None  # the law takes the prior's place
                    unknowns.append(replace(q, name=f"{q.name} of {section.name}", prior=prior))
            self._unknown_of.append(np.array(numbers, dtype=np.int64))
        self.unknowns: tuple[Parameter, ...] = tuple(unknowns)
        of_laws = [self.templates[law.parameter] for law in laws]
        scaling = Scaling(of_laws)
        self.reference, self.log = scaling.reference, scaling.log
        self.largest = np.array([sd_of_bounds(q) for q in of_laws], dtype=np.float64)

    def law_of(self, name: str) -> int | None:
        """The number of the law of a parameter, or None."""
        return self._law_numbers.get(name)

    def is_common(self, name: str) -> bool:
        """Whether a parameter is shared, or follows a law."""
        return name in self.templates

    def on_common_scale(self, section: SectionReadings) -> SectionReadings:
        """A section whose common parameters start where those of the first do: one scale in all."""
        parameters = tuple(
            replace(q, start=self.templates[q.name].start) if q.name in self.templates else q
            for q in section.parameters
        )
        return replace(section, parameters=parameters)

    def law(self, k: int, covariates: Mapping[str, float], values: Floats) -> tuple[float, Floats]:
        """The value x(mu) of a law and its derivatives (c,) by its constants, SI.

        Args:
            k: number of the law.
            covariates: of a section.
            values: (N,) or (F,) unknowns, SI.

        Raises:
            ModelError: it has no value there.
        """
        mu, slopes = self.laws[k].at(covariates, values[self.constants[k]])
        if not np.isfinite(mu) or (self.log[k] and mu <= 0.0):
            name = self.laws[k].parameter
            raise ModelError(f"The law of {name} gives {mu:g}, outside its admissible range.")
        return self.to_scale(k, mu), slopes / self.scale_slope(k, mu)

    def to_scale(self, k: int, value: float) -> float:
        """The parameter of a law, SI, on its scale."""
        return float(np.log(value)) if self.log[k] else float(value / self.reference[k])

    def from_scale(self, k: int, x: float) -> float:
        """The parameter of a law, SI, from its scale."""
        return float(np.exp(x)) if self.log[k] else float(x * self.reference[k])

    def scale_slope(self, k: int, value: float) -> float:
        """Derivative of the parameter of a law, SI, by x."""
        return float(value if self.log[k] else self.reference[k])

    def expected_point(self, section: SectionReadings, values: Floats) -> Floats:
        """The parameters (n,) expected of a section, SI: its own at their priors or starts.

        Args:
            section: with its parameters and covariates.
            values: (F,) at least, the unknowns, SI.
        """
        expected = []
        for q in section.parameters:
            k = self.law_of(q.name)
            if q.name in self.shared:
                p = float(values[self.shared.index(q.name)])
            elif k is not None:
                p = self.from_scale(k, self.law(k, section.covariates, values)[0])
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
        p, slopes = values[numbers], np.zeros((len(numbers), len(self.unknowns)))
        for i, q in enumerate(section.parameters):
            if numbers[i] >= 0:
                slopes[i, numbers[i]] = 1.0
                continue
            k = self._law_numbers[q.name]
            x, by_constants = self.law(k, section.covariates, values)
            p[i] = self.from_scale(k, x)
            if not q.lower * (1 - _ON_BOUND) <= p[i] <= q.upper * (1 + _ON_BOUND):
                raise ModelError(_outside_bounds(q, float(p[i]), section.name))
            slopes[i, self.constants[k]] = by_constants * self.scale_slope(k, p[i])
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

    def scattered(self) -> Iterator[tuple[int, SectionReadings, int]]:
        """Law, section and unknown of each parameter that scatters about a law, in order."""
        for section, numbers in zip(self.sections, self._unknown_of, strict=True):
            for q, number in zip(section.parameters, numbers.tolist(), strict=True):
                k = self.law_of(q.name)
                if k is not None and self.scattering[k]:
                    yield k, section, number

    def law_rows(self, values: Floats) -> tuple[Floats, Floats]:
        """x(z) - x(mu) of all that scatters, (m,), and its derivatives (m, N), SI.

        Args:
            values: (N,) all unknowns, SI.
        """
        scattered = list(self.scattered())
        deviations, rows = np.zeros(len(scattered)), np.zeros((len(scattered), len(self.unknowns)))
        for j, (k, section, number) in enumerate(scattered):
            x, by_constants = self.law(k, section.covariates, values)
            deviations[j] = self.to_scale(k, values[number]) - x
            rows[j, number] = 1.0 / self.scale_slope(k, values[number])
            rows[j, self.constants[k]] = -by_constants
        return deviations, rows

    def by_common(
        self, section: SectionReadings, p: Floats, values: Floats, n: int
    ) -> tuple[Floats, Floats, Floats]:
        """How the parameters of a section follow from the common unknowns, all on their scales.

        Args:
            section: one of the sections, or a further one.
            p: (m,) its parameters, SI.
            values: (F,) at least, the unknowns, SI.
            n: rows of the arrays, padded with zeros.

        Returns:
            Phi (n, F), Z (n, K): which parameter follows which law, and the deviation of x from
            its law (n,).
        """
        F = self.n_common
        slope = Scaling(self.unknowns[:F]).slope(values[:F])
        Phi, Z, deviation = np.zeros((n, F)), np.zeros((n, len(self.laws))), np.zeros(n)
        for i, q in enumerate(section.parameters):
            k = self.law_of(q.name)
            if k is not None:
                x, by_constants = self.law(k, section.covariates, values)
                where = self.constants[k]
                Z[i, k], Phi[i, where] = 1.0, by_constants * slope[where]
                deviation[i] = self.to_scale(k, p[i]) - x
            elif q.name in self.shared:
                Phi[i, self.shared.index(q.name)] = 1.0
        return Phi, Z, deviation

    def problem(self, models: SectionModels, tau: Floats) -> Problem:
        """All sections as one problem.

        Args:
            models: of the sections.
            tau: (K,) scatter about the laws, on their scales.
        """
        laws = [k for k, _, _ in self.scattered()]
        blocks = [section.shared_columns for section in self.sections]
        columns = sp.block_diag([*blocks, sp.csr_array((len(laws), 0))], format="csr")
        return Problem(
            JointResponse(self, models),
            np.concatenate([*(section.measured for section in self.sections), np.zeros(len(laws))]),
            np.concatenate([*(section.sd for section in self.sections), tau[laws]]),
            self.unknowns,
            shared=SharedErrors(sp.csr_array(columns)) if columns.shape[1] else None,
        )


class JointResponse:
    """The readings of all sections, and the rows of the laws, as one response.

    Args:
        joint: the unknowns.
        models: of the sections.
    """

    def __init__(self, joint: JointUnknowns, models: SectionModels) -> None:
        self._joint, self._models = joint, models

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the N unknowns."""
        return tuple(q.name for q in self._joint.unknowns)

    @property
    def counts(self) -> Counts:
        """Costs so far."""
        return self._models.counts

    def admissible(self, p: Floats) -> str | None:
        """Why p (N,) is outside the domain, or None if it is inside."""
        try:
            self._joint.points(p)
            self._joint.law_rows(p)
        except ModelError as error:
            return str(error)
        return None

    def readings(self, p: Floats) -> Floats:
        """v(p), (g,), of all sections, then the rows of the laws."""
        return self.evaluate(p)[0]

    def evaluate(self, p: Floats) -> tuple[Floats, Floats]:
        """v(p), (g,), and its exact Jacobian, (g, N)."""
        sections = range(len(self._joint.sections))
        points, slopes = zip(*(self._joint.point(s, p) for s in sections), strict=True)
        answers = self._models.evaluate(dict(enumerate(points)))
        deviations, rows = self._joint.law_rows(p)
        v = [answers[s][0] for s in sections]
        J = [answers[s][1] @ slopes[s] for s in sections]
        return np.concatenate([*v, deviations]), np.concatenate([*J, rows])

    def sharpen(self, p: Floats) -> bool:
        """Improve the Jacobians at p (N,); returns whether any could be improved."""
        return self._models.sharpen(self._joint.points(p))


def sd_of_bounds(parameter: Parameter) -> float:
    """Standard deviation, on its scale, of a parameter that is uniform between its bounds."""
    scaling = Scaling([parameter])
    width = float(scaling.upper[0] - scaling.lower[0])
    return (width if np.isfinite(width) else UNBOUNDED_RANGE) / math.sqrt(12.0)


def _outside_bounds(q: Parameter, value: float, section: str) -> str:
    value, low, high = (in_unit(x, q.unit, q.dimension) for x in (value, q.lower, q.upper))
    unit = f" {shown_unit(q.unit, q.dimension)}".rstrip()
    return (
        f"The law of {q.name} gives {value:.4g}{unit} for {section}, outside its "
        f"bounds {low:.4g}{unit} to {high:.4g}{unit}."
    )
