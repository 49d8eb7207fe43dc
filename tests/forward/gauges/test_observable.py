"""What gauges read beside displacements: tried with the axial force of a bolt."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from support.cases import displacement
from support.derivatives import assert_exact
from support.load_cells import GAUGES, VALUES, P, cell, nailed

from geoident.errors import InputError


def test_a_load_cell_reads_the_axial_force_of_its_bolt():
    survey = nailed(*GAUGES).survey(P, fields=False)
    stages = ["open", "bolt", "go on", "cut"]
    forces = survey.members.axial[:, stages.index("go on")]
    assert np.abs(forces).min() > 1.0
    np.testing.assert_allclose(survey.computed[1:3, stages.index("go on")], forces, rtol=1e-14)
    before = survey.computed[1:3, stages.index("bolt")]  # free of stress when it is built
    assert np.abs(before).max() < 1e-12 * np.abs(forces).max()


def test_it_is_read_while_the_bolt_stands():
    staged = nailed(*GAUGES)
    assert staged.unreadable("n1", "go on") is None
    assert staged.unreadable("n1", "open") == "its bolt does not stand then"
    assert staged.unreadable("n1", "cut") == "its bolt does not stand then"
    assert "later stage" in staged.unreadable("late", "bolt")


def test_forces_are_differentiated_exactly_beside_displacements():
    response = nailed(*GAUGES).response([("n1", "go on"), ("d", "go on"), ("n2", "go on")])
    assert_exact(response, P, tuple(VALUES))


def test_methods_of_unit_forces_along_readings_refuse_it():
    staged = nailed(*GAUGES)
    for why in (
        staged.response([("d", "open"), ("n1", "go on")]).obstacle(),
        staged.response([("n1", "go on")]).system_obstacle(),
    ):
        assert why == "gauge 'n1' reads something else than displacements"


def test_a_cell_between_points_without_a_bolt_is_a_fault():
    with pytest.raises(InputError) as error:
        nailed(GAUGES[0], cell("x", (1.1, 2.1), (3.6, 0.7)))
    (fault,) = error.value.faults
    assert fault.code == "no-bolt"
    assert fault.path == "gauges.x"
    assert "from (1.1, 2.1) m to (3.6, 0.7) m" in fault.message


def test_every_point_outside_the_mesh_and_every_missing_bolt_is_said_at_once():
    far = replace(displacement("far", (9.0, 6.0), (1.0, 0.0)), first=(7.0, 8.0))
    wide = replace(displacement("wide", (1.0, 1.5), (1.0, 0.0)), first=(-3.0, 2.0))
    cells = (cell("x", (1.1, 2.1), (3.6, 0.7)), cell("y", (1.2, 0.4), (3.4, 3.2)))
    with pytest.raises(InputError) as error:
        nailed(far, wide, *cells)
    said = "\n".join(fault.message for fault in error.value.faults)
    assert len(error.value.faults) == 5
    for place in ("(7, 8) m", "(9, 6) m", "(-3, 2) m", "'x'", "'y'"):
        assert place in said, said
