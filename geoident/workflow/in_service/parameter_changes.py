"""A parameter of a structure on its mesh that changes: what it does to gauges, and how much it is.

A likelihood ratio asks for the derivatives of the readings (`identify.in_time.detection`). They
hold for small changes: the size that follows from them is the one that the model, solved again with
another value, would show in the same way (theory 16.4).
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from geoident.forward.in_service.structure import ServiceModel
from geoident.identify.in_time.detection import Detector, ParameterChange
from geoident.identify.in_time.innovations import Filter
from geoident.model.arrays import Floats
from geoident.model.parameter import Parameter
from geoident.model.results.in_service import ParameterChangeRow
from geoident.model.results.result import Result
from geoident.workflow.in_service.fitted_gauges import FittedGauge

_LARGEST = 0.99
"""Of 1 - before / after: what rises a hundredfold is rigid."""

_SOLVED = 2
"""Times that the model is solved for a size; the next one would move it by little."""


class ChangingStructure:
    """A fitted structure one of whose parameters takes another value.

    Args:
        model: of it.
        fit: with the values before.

    Attributes:
        known: parameters that the fit has determined, in the order of its terms.
    """

    def __init__(self, model: ServiceModel, fit: Result) -> None:
        assert fit.seasonal is not None
        self._model, self._p, self._channels = model, fit.parameters.values, fit.gauges.channels
        parameters = {parameter.name: parameter for parameter in model.case.parameters}
        self.known = [parameters[fit.seasonal.terms[k]] for k in fit.seasonal.shared]

    def value(self, name: str) -> float:
        """Of a parameter before it changes, SI."""
        return float(self._p[self._model.names.index(name)])

    def _with(self, name: str, value: float) -> Floats:
        p = self._p.copy()
        p[self._model.names.index(name)] = value
        return p

    def why_not(self, name: str, value: float) -> str | None:
        """Why a parameter cannot have a value, SI, or None."""
        return self._model.admissible(self._with(name, value))

    def _acting(self, p: Floats, gauge: FittedGauge, times: Floats, earlier: float) -> Floats:
        """(m, 1 + n) motions of a gauge, with derivatives, that a parameter changes from now on.

        The temperature without stress is not known. It is taken to be the usual mean, from which a
        parameter that changes moves nothing. What has crept before stays.
        """
        rows, fitted = np.full(len(times), gauge.number), gauge.errors.times
        acting = self._model.motions(p, rows, times, times - earlier)
        usual = self._model.motions(p, np.full(len(fitted), gauge.number), fitted)
        motion = acting.total - usual.parts["temperature"].mean(axis=0)
        if "creep" in acting.parts:
            motion -= acting.parts["creep"][:1]
        return np.asarray(motion)

    def derivatives(self, gauge: FittedGauge, over: Filter, earlier: float = 0.0) -> Floats:
        """(m, h) what known parameters that rise by their own size add to readings, SI.

        Args:
            gauge: that is read.
            over: its readings.
            earlier: what acts on them acted so much earlier, s.
        """
        at = [self._model.names.index(parameter.name) for parameter in self.known]
        slopes = self._acting(self._p, gauge, over.times, earlier)[:, 1:]
        return np.asarray(slopes[:, at] * [abs(self._p[h]) or 1.0 for h in at])

    def motion(
        self, name: str, value: float, gauge: FittedGauge, over: Filter, earlier: float = 0.0
    ) -> Floats:
        """(m,) what a parameter at another value, SI, adds to readings; see `derivatives`."""
        before, after = (
            self._acting(p, gauge, over.times, earlier)[:, 0]
            for p in (self._p, self._with(name, value))
        )
        return np.asarray(after - before)

    def rows(
        self,
        change: ParameterChange,
        number: int,
        detector: Detector,
        gauges: Sequence[FittedGauge],
    ) -> tuple[list[ParameterChangeRow], list[Floats]]:
        """A change, a row for each parameter that it may be, and what it does to innovations (m,).

        Args:
            change: as the derivatives show it.
            number: of it, from 1.
            detector: over the readings.
            gauges: that were read.
        """
        showing = ", ".join(self._channels[gauges[i].number] for i in change.gauges)
        rows: list[ParameterChangeRow] = []
        effects: list[Floats] = []
        parts = zip(change.parameters, change.odds, change.size, strict=True)
        for h, odds, (size, *ends) in parts:
            parameter = self.known[h]
            sized = _Sized(self, parameter, change, h, detector, gauges)
            after = sized.value_of(size, _SOLVED)
            effects = effects or sized.effects
            interval = [sized.value_of(end, 1) for end in ends]
            rows.append(
                ParameterChangeRow(
                    change=number, parameter=parameter.name, gauges=showing, shown=change.shown,
                    since=change.since, earliest=change.earliest, latest=change.latest,
                    before=self.value(parameter.name), after=after, lower95=min(interval),
                    upper95=max(interval), odds=odds, surprise=change.surprise, lasts=change.lasts,
                    unit=parameter.unit, dimension=parameter.dimension,
                )
            )  # fmt: skip
        return rows, effects


class _Sized:
    """Values of a parameter that show as sizes of its derivatives.

    The search goes along 1 - before / after, in which displacements by a modulus are straight; of a
    parameter that may be negative along the value.

    Attributes:
        effects: of the last value, on the innovations (m,) of each gauge.
    """

    def __init__(
        self,
        structure: ChangingStructure,
        parameter: Parameter,
        change: ParameterChange,
        h: int,
        detector: Detector,
        gauges: Sequence[FittedGauge],
    ) -> None:
        self._structure, self._parameter, self._change, self._h = structure, parameter, change, h
        self._detector, self._gauges = detector, gauges
        self._before = structure.value(parameter.name)
        self._positive = parameter.lower > 0.0
        self._straight = 1.0
        self.effects: list[Floats] = []

    def _value(self, along: float) -> float:
        if self._positive:
            return self._before / (1.0 - min(along, _LARGEST))
        return self._before + along * (abs(self._before) or 1.0)

    def value_of(self, size: float, times: int) -> float:
        """The value, SI, that shows as a size; the model is solved so many times."""
        name = self._parameter.name
        for _ in range(times):
            along = size * self._straight
            while self._structure.why_not(name, self._value(along)) is not None:
                along *= 0.5
            motions = [
                self._structure.motion(name, self._value(along), gauge, over)
                for gauge, over in zip(self._gauges, self._detector.filters, strict=True)
            ]
            seen, self.effects = self._detector.seen_of(self._change, self._h, motions)
            if seen * size <= 0.0:
                break
            self._straight = min(along, _LARGEST) / seen if self._positive else along / seen
        return self._value(size * self._straight)
