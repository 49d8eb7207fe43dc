"""Forces in bolts, read by load cells, identify parameters beside displacements."""

from __future__ import annotations

import numpy as np
from support.load_cells import GAUGES, VALUES, nailed

from geoident.identify.problem.methods import identify
from geoident.identify.problem.problem import Problem
from geoident.model.methods import GaussNewtonOptions


def test_stiffness_of_rock_and_bolts_is_found_from_forces_and_displacements():
    staged = nailed(*GAUGES, free=("E", "EA", "p"))
    pairs = [("d", "open"), ("d", "go on"), ("n1", "go on"), ("n2", "go on")]
    response = staged.response(pairs)
    sd = np.array([1e-5, 1e-5, 1e2, 1e2])  # m and N
    truth = np.array([VALUES["E"], VALUES["EA"], VALUES["p"]]) * [1.7, 0.6, 1.2]
    problem = Problem(response, response.readings(truth), sd, staged.case.parameters)
    found = identify(problem, [GaussNewtonOptions()], lambda _: None)
    np.testing.assert_allclose(found.values, truth, rtol=1e-5)
