"""What the readings do not determine, for the people who placed the gauges.

The undetermined directions of readings and priors together are gaps that remain. The undetermined
directions of the readings alone that are not among them are held by a prior only. For a gap of two
parameters that change in proportion, their ratio (or product) is what the readings do determine,
and is given with its interval.

A direction is read in relative changes of the parameters, w = d(ln p), so that "E and sigma_v
scaled by one factor" is the direction (1, 1) whatever their units and scales. A parameter whose
bounds have zero between them has no relative change; its scaled x takes the place.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from geoident.identify.assessment.spectrum import SingularDirections, sparse_basis, without
from geoident.model.arrays import Bools, Floats
from geoident.model.parameter import Parameter
from geoident.model.results.bands import NORMAL_95
from geoident.model.results.findings import Finding

NOTICEABLE = 0.15
"""Entries below this part of the largest are not named."""

SIMILAR = 0.05
"""Entries that differ by less than this part count as equal."""

LEANING = 0.5
"""Share of a parameter's variance due to the prior of another from which on this is reported."""

PAIR_HALF_WIDTH = 0.5
"""A ratio or product is reported if its logarithm is known to this half width."""


@dataclass(frozen=True)
class Direction:
    """A direction with its noticeable entries.

    Args:
        indices: of the parameters in it.
        names: their names.
        weights: their relative changes, the largest of size one, the first positive.
        relative: every entry is a relative change.
    """

    indices: tuple[int, ...]
    names: tuple[str, ...]
    weights: tuple[float, ...]
    relative: bool

    @classmethod
    def of(cls, w: Floats, names: Sequence[str], relative: Sequence[bool]) -> Direction:
        """Keeps the noticeable entries.

        Args:
            w: (n,) relative changes of the parameters.
            names: of the parameters.
            relative: for each, whether its entry is a relative change.
        """
        size = np.abs(w)
        kept = [int(i) for i in np.flatnonzero(size > NOTICEABLE * size.max())]
        weights = w[kept] / size.max() * np.sign(w[kept[0]])
        return cls(
            tuple(kept),
            tuple(names[i] for i in kept),
            tuple(float(a) for a in weights),
            all(relative[i] for i in kept),
        )

    @property
    def equal(self) -> bool:
        """All entries are relative changes of the same size."""
        return self.relative and min(abs(a) for a in self.weights) > 1.0 - SIMILAR

    def phrase(self) -> str:
        """Why the readings cannot separate the parameters along the direction.

        >>> Direction((0, 1), ("E", "sigma_v"), (1.0, 1.0), True).phrase()
        'scaled by one factor, they leave the readings the same within the errors'
        >>> Direction((0, 1), ("E", "nu"), (1.0, 0.4), True).phrase()
        'rising or falling together, they leave the readings the same within the errors'
        >>> Direction((0, 1), ("E", "nu"), (1.0, -0.4), True).phrase()
        'one can make up for the other'
        >>> Direction((0, 1, 2), ("E", "nu", "K0"), (1.0, 0.8, -0.4), True).phrase()
        'a fall of K0 can make up for a rise of E and nu'
        """
        up = [name for name, a in zip(self.names, self.weights, strict=True) if a > 0.0]
        down = [name for name, a in zip(self.names, self.weights, strict=True) if a < 0.0]
        if not down:
            how = "scaled by one factor" if self.equal else "rising or falling together"
            return f"{how}, they leave the readings the same within the errors"
        if len(self.names) == 2:
            return "one can make up for the other"
        return f"a fall of {join(down)} can make up for a rise of {join(up)}"


def join(names: Sequence[str], last: str = "and") -> str:
    """A list in words.

    Args:
        names: at least one.
        last: what stands before the last of them.

    >>> join(["E", "nu", "K0"])
    'E, nu and K0'
    """
    return f" {last} ".join(filter(None, [", ".join(names[:-1]), names[-1]]))


@dataclass(frozen=True)
class Knowledge:
    """What the singular values tell of the n parameters.

    Args:
        parameters: the n unknowns.
        values: (n,) the estimate, SI.
        at_bound: (n,) the value lies on a bound.
        from_prior: (n,) hardly better known than by its prior.
        prior_rows: (k, n) rows of the priors in z.
        width: (n,) admissible range, SI, by the slope at the estimate.
        whole: directions of readings and priors.
        readings: directions of the readings alone.
    """

    parameters: tuple[Parameter, ...]
    values: Floats
    at_bound: Bools
    from_prior: Bools
    prior_rows: Floats
    width: Floats
    whole: SingularDirections
    readings: SingularDirections

    @property
    def relative(self) -> list[bool]:
        """Parameters (n) whose relative change makes sense."""
        return [q.lower > 0.0 or q.upper < 0.0 for q in self.parameters]

    def directions(self, vectors: Floats) -> Iterator[Direction]:
        """The directions of a basis (n, u) in z, by relative changes."""
        names = [q.name for q in self.parameters]
        safe = np.where(self.relative, self.values, 1.0)
        weight = np.where(self.relative, self.width / safe, 1.0)
        for vector in sparse_basis(vectors).T:
            yield Direction.of(weight * vector, names, self.relative)


def describe_gaps(known: Knowledge, covariance: Floats) -> tuple[Finding, ...]:
    """All findings at an estimate.

    Args:
        known: the singular directions, and which parameters are on bounds or known from priors.
        covariance: (n, n) SI, the undetermined directions as far as the bounds allow.
    """
    gaps = known.whole.undetermined_vectors
    remaining = list(known.directions(gaps))
    held = list(known.directions(without(known.readings.undetermined_vectors, gaps)))
    reported = {d.indices[0] for d in remaining + held if len(d.indices) == 1}
    return (
        *(_gap(known, d, _determined_pair(known, d, covariance)) for d in remaining),
        *(_held(known, d, _determined_pair(known, d, covariance)) for d in held),
        *_prior_only(known, reported),
        *_bounds(known),
    )


def _gap(known: Knowledge, direction: Direction, pair: str) -> Finding:
    """A direction that nothing determines."""
    if len(direction.names) > 1:
        return Finding("not-separated", ", ".join(direction.names), f"{_unseen(direction)}.{pair}")
    (i,) = direction.indices
    q, sentence = known.parameters[i], f"{_unseen(direction)}."
    if q.prior is not None and q.prior.narrows(q.lower, q.upper):
        sentence = f"{_unseen(direction)}: it is known only from its prior, which is wide."
    elif q.prior is not None:
        sentence = (
            f"{_unseen(direction)}, and its prior is as wide as its bounds: only these limit it."
        )
    return Finding("not-determined", q.name, sentence)


def _held(known: Knowledge, direction: Direction, pair: str) -> Finding:
    """A direction that only a prior determines."""
    names = [q.name for q in known.parameters if q.prior and q.name in direction.names]
    if len(direction.names) == 1:
        prior = "its prior" if names else "the priors"
        sentence = f"{_unseen(direction)}: it is known only from {prior}."
    else:
        of = f" of {join(names)}" if names else ""
        separate = f"prior{of} separates" if len(names) == 1 else f"priors{of} separate"
        sentence = f"{_unseen(direction)}. Only the {separate} them.{pair}"
    return Finding("only-prior", ", ".join(direction.names), sentence)


def _unseen(direction: Direction) -> str:
    """That the readings do not determine a direction; the sentence goes on."""
    if len(direction.names) == 1:
        return f"The readings do not determine {direction.names[0]}"
    return f"The readings cannot separate {join(direction.names)}: {direction.phrase()}"


def _determined_pair(known: Knowledge, direction: Direction, covariance: Floats) -> str:
    """The ratio or product that stays determined where two parameters change in proportion."""
    if len(direction.indices) != 2 or not direction.equal:
        return ""
    i, j = direction.indices
    sign = -1.0 if direction.weights[1] > 0.0 else 1.0
    if sign < 0.0 and abs(known.values[i]) > abs(known.values[j]):
        i, j = j, i
    slope = np.zeros(len(known.values))  # of ln p_i + sign ln p_j
    slope[[i, j]] = np.array([1.0, sign]) / known.values[[i, j]]
    half = NORMAL_95 * float(np.sqrt(max(float(slope @ covariance @ slope), 0.0)))
    if not half <= PAIR_HALF_WIDTH:
        return ""
    names = known.parameters[i].name, known.parameters[j].name
    text = f"{names[0]} / {names[1]}" if sign < 0.0 else f"{names[0]} * {names[1]}"
    value = float(known.values[i] * known.values[j] ** sign)
    low, high = sorted([float(value * np.exp(-half)), float(value * np.exp(half))])
    return f" {text} is determined: {value:.4g} (95 %: {low:.4g} to {high:.4g}, SI units)."


def _prior_only(known: Knowledge, reported: set[int]) -> Iterator[Finding]:
    """Parameters that hardly gained from the readings, and those that lean on their priors.

    With the posterior covariance C, an error of one standard deviation in the prior row P_k
    moves the estimate by C P_k^T, so (C P_k^T)_i^2 / C_ii is its share of the variance of i.
    """
    covariance = known.whole.determined_covariance
    for i, parameter in enumerate(known.parameters):
        if not known.from_prior[i] or i in reported:
            continue
        rows = known.prior_rows[known.prior_rows[:, i] != 0.0]
        part = ((covariance @ rows.T) ** 2).sum(axis=1)
        leans = part / np.maximum(np.diag(covariance), 1e-300) > LEANING
        leaning = [
            q.name
            for j, q in enumerate(known.parameters)
            if j != i and not known.from_prior[j] and leans[j]
        ]
        also = f" The results for {join(leaning)} rest mainly on that prior." if leaning else ""
        yield only_prior(parameter.name, also)


def only_prior(name: str, also: str = "") -> Finding:
    """That a parameter is hardly better known than by its prior.

    Args:
        name: of the parameter.
        also: a further sentence, after a blank.
    """
    sentence = f"{name} is known only from its prior: the readings hardly add to it.{also}"
    return Finding("only-prior", name, sentence)


def _bounds(known: Knowledge) -> Iterator[Finding]:
    """Parameters that a bound holds."""
    for i, parameter in enumerate(known.parameters):
        if known.at_bound[i] and parameter.lower < parameter.upper:
            low = known.values[i] - parameter.lower < parameter.upper - known.values[i]
            side, way, more = ("lower", "above", "less") if low else ("upper", "below", "more")
            yield Finding(
                "at-bound",
                parameter.name,
                f"{parameter.name} lies on its {side} bound: the readings limit how far {way} it "
                f"the value may be, but the bound itself is an assumption. If the ground may have "
                f"{more}, widen the bound.",
            )
