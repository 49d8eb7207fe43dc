"""The published small benchmarks of yield limits in frames, as complementarity systems."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import scipy.sparse as sp

from geoident.forward.equation_arrays import (
    Affine,
    EquationArrays,
    LoadStage,
    PointLaw,
    PointSet,
    fixed,
)
from geoident.model.arrays import Floats
from geoident.model.parameter import Parameter

DATA = Path(__file__).parents[1] / "identification" / "frames"


def load(name: str) -> dict[str, Any]:
    return dict(json.loads((DATA / f"{name}.json").read_text(encoding="utf-8")))


def foundation(model: str) -> tuple[EquationArrays, Floats, tuple[Parameter, ...]]:
    """A beam on springs, ``a10t`` for finda10t; its readings and parameters."""
    data = load("foundation")
    gauges, level, bounds = data["gauges"][model[0]], model[1:3], data["bounds"][model[3]]
    d, h = data["n_nodes"], data["spacing"]
    curvature = sp.diags_array([-1.0, 2.0, -1.0], offsets=[0, 1, 2], shape=(d - 2, d)) / h
    names = tuple(data["parameters"])
    sets = (_bars("beam", curvature, len(names)), _bars("springs", sp.eye_array(d), len(names)))
    laws = tuple(
        _two_sided(
            1.0 / data[f"{what}_flexibility"], names, [first, first + 2], [first + 4, first + 6]
        )
        for first, what in enumerate(("beam", "spring"))
    )
    forces = np.zeros(d)
    for node, force in data["loads"][level[0]].items():
        forces[int(node)] = force
    system = _one_stage(names, sets, laws, forces, sp.eye_array(d).tocsr()[gauges])
    measured = np.array(data["readings"][level])[gauges]
    parameters = tuple(
        Parameter(name, start=0.5 * (low + high), lower=low, upper=high)
        for name, (low, high) in zip(names, bounds, strict=True)
    )
    return system, measured, parameters


def truss(case: str) -> tuple[EquationArrays, Floats, tuple[Parameter, ...]]:
    """Eleven bars, ``a`` for nappi_a; yield limits and hardening of chords and diagonals."""
    data = load("truss")
    names = ("k_chord", "k_diagonal", "H_chord", "H_diagonal")
    C, E = np.array(data["compatibility"]), np.array(data["stiffness"])
    sets, laws = [], []
    for g, group in enumerate(("chords", "diagonals")):
        bars = data[group]
        sets.append(_bars(group, sp.csr_array(C[bars]), len(names)))
        laws.append(_two_sided(float(E[bars[0]]), names, [g, g], [2 + g, 2 + g]))
    case_data = data["cases"][case]
    rows = sp.eye_array(C.shape[1]).tocsr()
    system = _one_stage(names, tuple(sets), tuple(laws), np.array(case_data["loads"]), rows)
    parameters = tuple(
        Parameter(name, start=0.5 * sum(data["bounds"][name[0]]), lower=low, upper=high)
        for name, (low, high) in ((name, data["bounds"][name[0]]) for name in names)
    )
    return system, np.array(case_data["readings"]), parameters


def _bars(name: str, compatibility: Any, n: int) -> PointSet:
    m = compatibility.shape[0]
    return PointSet(name, sp.csr_array(compatibility), np.ones(m), fixed(np.zeros((1, m)), n))


def _two_sided(modulus: float, names: tuple[str, ...], k: list[int], H: list[int]) -> PointLaw:
    """Yielding in tension and in compression, each with its own distance and hardening."""
    n = len(names)
    distances, hardening = np.zeros((2, n)), np.zeros((2, 2, n))
    for side in range(2):
        distances[side, k[side]] = 1.0
        hardening[side, side, H[side]] = 1.0
    return PointLaw(
        fixed(np.array([[modulus]]), n),
        np.array([[1.0], [-1.0]]),
        Affine(np.zeros(2), distances),
        Affine(np.zeros((2, 2)), hardening),
    )


def _one_stage(
    names: tuple[str, ...],
    sets: tuple[PointSet, ...],
    laws: tuple[PointLaw, ...],
    forces: Floats,
    rows: Any,
) -> EquationArrays:
    d, n = len(forces), len(names)
    every = {s: s for s in range(len(sets))}
    stage = LoadStage("load", -1, every, frozenset(), np.arange(d), fixed(forces, n))
    g = rows.shape[0]
    active = np.ones((1, g))
    return EquationArrays(
        names, sets, laws, (stage,), sp.csr_array(rows), active, fixed(np.zeros(g), n)
    )
