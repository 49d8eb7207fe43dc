"""The condensed problem of a small box, exactly: branch and bound over complementarities.

    min  sum r^2 + priors     r = v_0 + V_p p + V_lam lam
    s = s_0 + S_p p + M lam + h(p, lam),   (s_i, lam_i) a special ordered set: one of them is zero

by SCIP (Bestuzheva and others 2021), with the energy inequality of `parameter_boxes`, which follows
from the complementarity but not from its relaxation. Products of hardening and multipliers, if any,
are quadratic equations, which SCIP branches on as well.
"""

from __future__ import annotations

from dataclasses import dataclass
from importlib import import_module
from typing import Any

import numpy as np

from geoident.identify.yield_limits.condensed_system import CondensedSystem
from geoident.identify.yield_limits.parameter_boxes import (
    NEGLIGIBLE,
    EnergyForm,
    EnergyInequality,
    ParameterBox,
)
from geoident.model.arrays import Floats

_MOST_NODES = 500
"""Then cutting the box is better. Not seconds: the same run gives the same numbers."""


@dataclass(frozen=True)
class Solved:
    """The result of branch and bound in a box.

    Args:
        bound: proven lower bound of the discrepancy; infinite where nothing is below the best.
        p: (n,) the best scaled parameters, or None.
        complete: the box is done with; otherwise the nodes were used up.
    """

    bound: float
    p: Floats | None
    complete: bool


def solve_box(
    system: CondensedSystem, box: ParameterBox, form: EnergyForm | None, *, best: float, gap: float
) -> Solved:
    """Branch and bound over the pairs of a box.

    Args:
        system: the whole condensed system.
        box: of its parameters.
        form: of the energy of the whole system, or None where parameters change it.
        best: the lowest discrepancy known; only what is below is of interest.
        gap: relative difference of bound and optimum that is near enough.
    """
    scip: Any = import_module("pyscipopt")
    model = scip.Model()
    model.hideOutput()
    part = system.only(box.kept)

    def linear(constant: float, row: Floats, variables: list[Any]) -> Any:
        some = np.flatnonzero(np.abs(row) > NEGLIGIBLE)
        return scip.quicksum(float(row[j]) * variables[j] for j in some) + float(constant)

    p = [model.addVar(lb=a, ub=b) for a, b in zip(box.lower, box.upper, strict=True)]
    lam = [model.addVar(lb=0.0) for _ in box.kept]
    rows = np.hstack([part.slack_by_p, part.slack_by_lam])
    for i, (constant, row) in enumerate(zip(part.slack, rows, strict=True)):
        value = linear(constant, row, p + lam)
        for h, product in part.products.items():
            if product[i].any():
                value = value + p[h] * linear(0.0, product[i], lam)
        slack = model.addVar(lb=0.0)
        model.addCons(slack == value)
        model.addConsSOS1([lam[i], slack], [1, 2])
    edge = float(np.sqrt(best))
    r = [model.addVar(lb=-edge, ub=edge) for _ in part.misfit]
    rows = np.hstack([part.misfit_by_p, part.misfit_by_lam])
    for variable, constant, row in zip(r, part.misfit, rows, strict=True):
        model.addCons(variable == linear(constant, row, p + lam))
    total = model.addVar(lb=0.0, ub=best)
    model.addCons(scip.quicksum(x * x for x in r) <= total)
    model.setObjective(total)
    few = None if form is None else form.only(box.kept)
    energy = EnergyInequality(part, few, box.lower, box.upper)
    if energy.convex and lam:
        size = float(np.abs(energy.linear).max(initial=0.0)) or 1.0
        y = []
        for row in np.linalg.qr(energy.root, mode="r") / np.sqrt(size):
            y.append(model.addVar(lb=None))
            model.addCons(y[-1] == linear(0.0, row, lam))
        straight = linear(0.0, energy.linear / size, lam)
        model.addCons(scip.quicksum(x * x for x in y) + straight <= 0.0)
    model.setParam("limits/nodes", _MOST_NODES)
    model.setParam("limits/gap", float(gap))
    model.optimize()
    status = model.getStatus()
    if status == "infeasible":
        return Solved(np.inf, None, True)
    point = np.array([model.getVal(x) for x in p]) if model.getNSols() else None
    bound = max(box.bound, float(model.getDualbound()))
    return Solved(bound, point, status in ("optimal", "gaplimit"))
