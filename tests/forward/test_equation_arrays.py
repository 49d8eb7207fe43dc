"""The bilinear system of a staged system against the equations themselves, set by set."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from geoident.forward.equation_arrays import (
    Affine,
    EquationArrays,
    LoadStage,
    PointLaw,
    PointSet,
    bilinear,
)

N_DOFS, N = 7, 3
"""Degrees of freedom and parameters."""


def affine(rng, *shape, only=None):
    """A random affine array, moved by all parameters or by some."""
    slopes = rng.normal(size=(*shape, N))
    if only is not None:
        slopes[..., [h for h in range(N) if h not in only]] = 0.0
    return Affine(rng.normal(size=shape), slopes)


def point_set(rng, name, points, strain):
    compatibility = sp.csr_array(rng.normal(size=(strain * points, N_DOFS)))
    return PointSet(name, compatibility, rng.uniform(0.5, 2.0, points), affine(rng, strain, points))


def point_law(rng, planes, strain, *, moves=(0, 1, 2), hardens=(1,)):
    return PointLaw(
        affine(rng, strain, strain, only=moves),
        rng.normal(size=(planes, strain)),
        affine(rng, planes),
        affine(rng, planes, planes, only=hardens),
    )


def equation_arrays():
    """Two sets; laws that change, with as many planes or more; a set that is absent for a time."""
    rng = np.random.default_rng(2)
    sets = (point_set(rng, "wide", 2, 3), point_set(rng, "thin", 3, 1))
    laws = (
        point_law(rng, 2, 3, moves=(2,)),
        point_law(rng, 3, 3),
        point_law(rng, 2, 1, hardens=(0, 2)),
        point_law(rng, 2, 3, moves=()),
        point_law(rng, 0, 1, moves=(0,)),
    )

    def stage(name, base, of_sets, fresh, dofs):
        force = affine(rng, N_DOFS)
        return LoadStage(name, base, of_sets, frozenset(fresh), np.array(dofs), force)

    stages = (
        stage("first", -1, {0: 0, 1: 2}, (), [5, 0, 3, 1]),
        stage("other law", 0, {0: 3, 1: 2}, (), [1, 2, 0, 5, 6]),
        stage("anew", 1, {1: 2, 0: 3}, (1,), [4, 1]),
        stage("more planes", 1, {0: 1}, (), [0, 6, 2]),
        stage("back", 3, {0: 1, 1: 4}, (), [3, 2, 1, 0, 5]),
        stage("once more", 2, {0: 3, 1: 2}, (), [6, 5, 4]),
    )
    rows = sp.csr_array(rng.normal(size=(4, N_DOFS)))
    active = rng.normal(size=(len(stages), 4))
    names = ("a", "b", "c")
    return EquationArrays(names, sets, laws, stages, rows, active, affine(rng, 4))


def unknowns(staged, x):
    """(stage, None) to du (n_dofs,), (stage, set) to sigma (s, m) and dlam (y, m), and the rest."""
    parts, at = {}, 0

    def take(count):
        nonlocal at
        at += count
        return x[at - count : at]

    for j, stage in enumerate(staged.stages):
        parts[j, None] = np.zeros(staged.n_dofs)
        parts[j, None][stage.dofs] = take(len(stage.dofs))
        for s, law in stage.laws.items():
            points = staged.sets[s]
            sigma = take(points.n_strain * points.n_points).reshape(points.n_strain, -1)
            planes = staged.laws[law].n_planes
            parts[j, s] = sigma, take(planes * points.n_points).reshape(planes, points.n_points)
    return parts, x[at:]


def history(staged, parts, j, s):
    """dlam (y, m) so far: as long as the set stays, with as many planes."""
    planes = staged.laws[staged.stages[j].laws[s]].n_planes
    total = parts[j, s][1].copy()
    while s not in staged.stages[j].fresh and staged.stages[j].base >= 0:
        j = staged.stages[j].base
        law = staged.stages[j].laws.get(s)
        if law is None or staged.laws[law].n_planes != planes:
            break
        total += parts[j, s][1]
    return total


def values(staged, x, p):
    """Equations, slacks and readings as the module states them."""
    parts, rest = unknowns(staged, x)
    assert not rest.size
    equations, slacks, readings = [], [], staged.offset.at(p)
    for j, stage in enumerate(staged.stages):
        du, total = parts[j, None], stage.forces.at(p)
        for s in stage.laws:
            points = staged.sets[s]
            pulled = (parts[j, s][0] * points.volume).ravel()
            total = total - points.compatibility.toarray().T @ pulled
        equations.append(total[stage.dofs])
        readings = readings + staged.active[j] * (staged.rows.toarray() @ du)
        for s, number in stage.laws.items():
            points, law = staged.sets[s], staged.laws[number]
            sigma, multipliers = parts[j, s]
            strain = (points.compatibility.toarray() @ du).reshape(sigma.shape)
            before = np.zeros_like(sigma)
            if s not in stage.fresh:
                if stage.base < 0:
                    before = points.initial.at(p)
                elif (stage.base, s) in parts:
                    before = parts[stage.base, s][0]
            elastic = strain - law.normals.T @ multipliers
            equations.append((sigma - before - law.elasticity.at(p) @ elastic).ravel())
            limits = law.distances.at(p)[:, None]
            limits = limits + law.hardening.at(p) @ history(staged, parts, j, s)
            slacks.append((limits - law.normals @ sigma).ravel())
    return np.concatenate(equations), np.concatenate(slacks), readings


def test_it_has_the_equations_the_slacks_and_the_readings_of_the_stages():
    staged, rng = equation_arrays(), np.random.default_rng(5)
    system = bilinear(staged, np.array([0.4, -0.3, 0.7]))
    n = system.equations.by_x.shape[1]
    for _ in range(3):
        x, p = rng.normal(size=n), rng.normal(size=N)
        for found, wanted in zip(
            (system.equations, system.slacks, system.readings), values(staged, x, p), strict=True
        ):
            c, A = found.at(p)
            np.testing.assert_allclose(c + A @ x, wanted, rtol=1e-12, atol=1e-12)
    assert sorted(system.equations.products) == [0, 1, 2]
    assert sorted(system.slacks.products) == [0, 1, 2]
    assert system.readings.products == {}
    assert system.names == staged.names
