"""The reduced model that a fit keeps: readings at any parameters, and how far they may be off."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from geoident.api.calling import spoken
from geoident.api.tables import ResultTable
from geoident.errors import UsageError
from geoident.forward.reduced.kept import RestoredModel
from geoident.model.arrays import Bools, Floats
from geoident.units import UnitError, in_unit, read_quantity, shown_unit
from geoident.workflow.running.computed import accuracies
from geoident.workflow.running.reduced_answers import CLOSE

ParameterValues = Mapping[str, float | str] | npt.ArrayLike
"""Name to value, a number in SI units or a text with its unit; or vectors (n,) or (b, n), SI."""


@dataclass(frozen=True, repr=False, eq=False)
class ReducedReadings:
    """Readings by a reduced model, with estimates of their errors. Arrays are SI.

    Args:
        pairs: channel and stage of each of the g readings.
        values: (g,), or (b, g) at b parameter vectors.
        errors: likewise: by how much the model on the mesh is estimated to read otherwise.
        accuracy: (g,) of the gauges.
        units: of the case, (g,) with the kind of quantity of each.
    """

    pairs: tuple[tuple[str, str], ...]
    values: Floats
    errors: Floats
    accuracy: Floats
    units: tuple[tuple[str, str], ...]

    @property
    def bounds(self) -> Floats:
        """The old name of `errors`, (g,) or (b, g), from when they were bounds."""
        return self.errors

    @property
    def close(self) -> Bools:
        """(g,) or (b, g): off by at most 2 % of the accuracy, which is what commands demand."""
        return np.asarray(self.errors <= CLOSE * self.accuracy)

    def __getitem__(self, pair: tuple[str, str]) -> npt.NDArray[np.float64] | float:
        """The reading of a channel at a stage; (b,) at several parameter vectors."""
        values = self.values[..., self.pairs.index(pair)]
        return float(values) if values.ndim == 0 else values

    @property
    def table(self) -> ResultTable:
        """Of one parameter vector: a row for each reading, in the units of the case.

        Raises:
            UsageError: there are several vectors.
        """
        if self.values.ndim != 1:
            msg = "a table is of one parameter vector; take 'values' and 'errors' for several"
            raise UsageError(msg)
        rows: list[tuple[str | float, ...]] = []
        for k, ((channel, stage), (unit, kind)) in enumerate(
            zip(self.pairs, self.units, strict=True)
        ):
            value, error = (in_unit(float(x[k]), unit, kind) for x in (self.values, self.errors))
            rows.append((channel, stage, value, error, shown_unit(unit, kind)))
        return ResultTable(("channel", "stage", "value", "error", "unit"), tuple(rows))

    def __repr__(self) -> str:
        vectors = 1 if self.values.ndim == 1 else len(self.values)
        part = 100.0 * float(np.mean(self.close))
        return (
            f"ReducedReadings({len(self.pairs)} readings at {vectors} parameter vectors, "
            f"{part:.3g} % estimated to be close)"
        )


class KeptModel:
    """The reduced model that a fit keeps. Called with parameters, it gives readings.

    Args:
        restored: the model with its case.
        estimate: (n,) what the fit found, for parameters that are not given.
    """

    def __init__(self, restored: RestoredModel, estimate: Floats) -> None:
        self._restored, self._estimate = restored, estimate

    @property
    def parameters(self) -> tuple[str, ...]:
        """Names of the n parameters, in the order of vectors."""
        return self._restored.names

    @property
    def domain(self) -> dict[str, tuple[float, float]]:
        """Name to the least and the largest value for which it answers, SI."""
        kept = self._restored.kept
        ends = zip(kept.lower.tolist(), kept.upper.tolist(), strict=True)
        return dict(zip(kept.names, ends, strict=True))

    @property
    def analyses(self) -> Floats:
        """(m, n) parameters at which the model was evaluated for it: there it is exact. SI."""
        return self._restored.kept.analyses

    @property
    def marches(self) -> Floats:
        """The old name of `analyses`, (m, n)."""
        return self.analyses

    @property
    def pairs(self) -> tuple[tuple[str, str], ...]:
        """Channel and stage of each of the g readings that it gives."""
        return self._restored.pairs

    @cached_property
    def _accuracy(self) -> Floats:
        kept = self._restored.kept
        return accuracies(self._restored.case)[kept.rows, kept.states - 1]

    @spoken
    def __call__(self, values: ParameterValues = (), /) -> ReducedReadings:
        """All readings, and how far they are estimated to be off.

        Args:
            values: by name, numbers in SI units or texts such as ``"12 GPa"``, the others as the
                fit found them; or a vector (n,), or vectors (b, n), SI.

        Raises:
            UsageError: a name is not known, a value is none, or beyond the domain.
        """
        single, points = self._points(values)
        for p in points:
            reason = self._restored.admissible(p)
            if reason is not None:
                raise UsageError(f"The reduced model does not answer there: {reason}.")
        response = self._restored.response(self.pairs)
        readings, errors = response.estimated(points)
        if single:
            readings, errors = readings[0], errors[0]
        channels = {c.name: (c.unit, c.dimension) for c in self._restored.case.channels}
        units = tuple(channels[channel] for channel, _ in self.pairs)
        return ReducedReadings(self.pairs, readings, errors, self._accuracy, units)

    def _points(self, values: ParameterValues) -> tuple[bool, Floats]:
        """Whether one vector was given, and all of them (b, n), SI."""
        n = len(self.parameters)
        if isinstance(values, Mapping):
            p = self._estimate.copy()
            for name, value in values.items():
                p[self._number(name)] = self._value(name, value)
            return True, p[None]
        given = np.asarray(values, dtype=np.float64)
        if given.size == 0:
            return True, self._estimate[None]
        if given.ndim not in (1, 2) or given.shape[-1] != n:
            msg = f"Vectors of {n} parameters are expected ({', '.join(self.parameters)})."
            raise UsageError(msg)
        return given.ndim == 1, np.atleast_2d(given)

    def _number(self, name: str) -> int:
        if name not in self.parameters:
            known = ", ".join(self.parameters)
            raise UsageError(f"There is no parameter {name!r}; the parameters are: {known}.")
        return self.parameters.index(name)

    def _value(self, name: str, value: float | str) -> float:
        if not isinstance(value, str):
            return float(value)
        parameter = self._restored.case.parameters[self._number(name)]
        try:
            return read_quantity(value, parameter.dimension).value
        except UnitError as error:
            raise UsageError(f"{name}: {error}") from error

    def __repr__(self) -> str:
        names = ", ".join(self.parameters)
        return f"KeptModel({len(self.pairs)} readings by {names}; of {len(self.analyses)} analyses)"
