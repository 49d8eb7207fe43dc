"""Chains of creep and stiffness by age, from the numbers of a case with derivatives."""

from __future__ import annotations

import numpy as np

from geoident.fem.creep import CreepChain, logarithmic_chain
from geoident.fem.elasticity import lame_constants
from geoident.model.arrays import Floats
from geoident.model.case import Material
from geoident.model.creep import (
    Ageing,
    ConcreteAgeing,
    CreepCurve,
    CreepElement,
    KelvinElement,
    StiffnessTable,
    ends,
)
from geoident.model.dual import Dual, ParameterPoint, joined
from geoident.model.ground import Isotropic, constants
from geoident.model.parameter import Parameter, Scalar

_PARTS = {"shear": (True, False), "volume": (False, True), "both": (True, True)}

_DAY = 86400.0
_OLD = 28.0 * _DAY
"""Age of concrete whose modulus is E, s."""

_SETS = 3600.0
"""Age from which on concrete has a stiffness, s: younger concrete has that of this age."""

_POINTS, _WEIGHTS = np.polynomial.legendre.leggauss(3)
"""Of the mean over a step: exact for what is of fifth order in time."""


class ChainMaker:
    """Makes the chain of a material at parameters.

    Args:
        material: that creeps.
        parameters: of the case, with their bounds.
        longest: the longest time of all stages together, s.
    """

    def __init__(
        self, material: Material, parameters: tuple[Parameter, ...], longest: float
    ) -> None:
        self._material = material
        self._logarithmic = {
            n: logarithmic_chain(_least(element.time, parameters), longest)
            for n, element in enumerate(material.creep)
            if isinstance(element, CreepCurve) and not ends(element)
        }

    def chain(self, point: ParameterPoint) -> CreepChain:
        """The chain at parameters."""
        shares, times, parts = [], [], []
        flow = point.constant(np.zeros(2))
        for n, element in enumerate(self._material.creep):
            of_part = np.array(_PARTS[element.part])
            if isinstance(element, CreepCurve):
                share, time = point.number(element.share), point.number(element.time)
                if n in self._logarithmic:
                    share_of, time_of, flow_of = self._logarithmic[n]
                    flow = flow + _wide(share / time * flow_of).times(of_part.astype(float))
                else:
                    share_of, time_of = np.ones(1), np.ones(1)
                share, time = _wide(share).times(share_of), _wide(time).times(time_of)
            else:
                elastic = self._elastic(element, point)
                viscosity = point.number(element.viscosity)
                if not isinstance(element, KelvinElement):
                    flow = flow + _wide(elastic / viscosity).times(of_part.astype(float))
                    continue
                modulus = point.number(element.modulus)
                share, time = _wide(elastic / modulus), _wide(viscosity / modulus)
            shares.append(share)
            times.append(time)
            parts += [of_part] * len(share.value)
        none = point.constant(np.zeros(0))
        return CreepChain(
            joined([none, *shares]),
            joined([none, *times]),
            np.array(parts, dtype=bool).reshape(-1, 2),
            flow,
        )

    def _elastic(self, element: CreepElement, point: ParameterPoint) -> Dual:
        """G of the elastic spring, Pa; K for an element in volume alone."""
        elastic = self._material.elastic
        assert isinstance(elastic, Isotropic)  # as the case was checked
        numbers = {name: point.number(c) for name, c in constants(elastic).items()}
        lame, mu = lame_constants(numbers)
        return lame + mu * (2.0 / 3.0) if element.part == "volume" else mu


def _least(time: Scalar, parameters: tuple[Parameter, ...]) -> float:
    """The least value of a time within the bounds of its parameter, s."""
    values = {one.name: max(one.lower, 1e-3 * one.start) for one in parameters}
    return time.value(values)


def _wide(number: Dual) -> Dual:
    """A number as an array (1,)."""
    return Dual(number.columns[None])


def grown(ageing: Ageing, E: Scalar | None, point: ParameterPoint, ages: Floats, h: float) -> Dual:
    """What there is of a stiffness (q,), on average over a step.

    Args:
        ageing: how it grows.
        E: Young's modulus that is the whole of it; needed for a table of moduli.
        point: the parameters.
        ages: (q,) at the beginning of the step, s; infinite for old ground.
        h: its size, s; finite.
    """
    different, places = np.unique(ages, return_inverse=True)
    total = Dual.constant(np.zeros(len(different)), len(point.names))
    for x, weight in zip(_POINTS, _WEIGHTS, strict=True):
        at = different + 0.5 * (1.0 + x) * h
        total = total + _stiffness(ageing, E, point, at) * (0.5 * weight)
    return total[places]


def _stiffness(ageing: Ageing, E: Scalar | None, point: ParameterPoint, ages: Floats) -> Dual:
    """The modulus (q,) at ages (q,), as part of E."""
    if isinstance(ageing, ConcreteAgeing):
        left = 1.0 - np.sqrt(_OLD / np.maximum(ages, _SETS))
        return _wide(point.number(ageing.s)).times(ageing.exponent * left).exp()
    if isinstance(ageing, StiffnessTable):
        moduli = [point.number(modulus) for modulus in ageing.moduli]
        rows = np.eye(len(moduli))
        weights = np.array([np.interp(ages, ageing.ages, row) for row in rows])
        value = sum(
            (_wide(m).times(w) for m, w in zip(moduli, weights, strict=True)),
            start=point.constant(np.zeros(len(ages))),
        )
        assert E is not None  # as the case was checked
        return value / _wide(point.number(E))
    share, time = _wide(point.number(ageing.share)), _wide(point.number(ageing.time))
    if ageing.law == "logarithmic":
        x = time.reciprocal().times(np.minimum(ages, _LONG * float(time.value[0])))
        return share * (x + 1.0).log() + 1.0
    x = time.reciprocal().times(np.minimum(ages, _OVER * float(time.value[0])))
    return share * ((-x).exp() * -1.0 + 1.0) + 1.0


_OVER, _LONG = 50.0, 1e12
"""Ages, in times of a law, beyond which it is as good as over, or nobody asks."""
