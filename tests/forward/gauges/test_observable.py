"""What gauges read beside displacements: tried with the axial force of a bolt."""

from __future__ import annotations

import numpy as np
import pytest
from support.cases import displacement, material, model, rollers
from support.derivatives import assert_exact
from support.meshes import box, regroup

from geoident.errors import InputError
from geoident.model.case import Stage
from geoident.model.gauges import Channel
from geoident.model.in_situ import ConstantStress
from geoident.model.parameter import Parameter, Scalar
from geoident.model.structures import Bolts

ENDS = (((1.1, 2.1), (3.4, 3.2)), ((1.2, 0.4), (3.6, 0.7)))
VALUES = {"E": 2e9, "EA": 3e8, "s": 1.5, "p": -2e6}


def cell(name: str, first, second, zero: str = "virgin") -> Channel:
    """A load cell on the bolt between two points."""
    return Channel(name, name, "load-cell", first, second, (1.0, 0.0), 1e3, zero, ("gauges", name))


def bolted(*channels: Channel):
    number = {name: Scalar(1.0, name) for name in VALUES}
    mesh = regroup(
        box("quad8", (4, 4), size=(4.0, 4.0)),
        core=lambda x: (x[:, 0] < 1.0) & (x[:, 1] > 1.0) & (x[:, 1] < 2.0),
        upper=lambda x: (x[:, 0] < 1.0) & (x[:, 1] > 2.0) & (x[:, 1] < 3.0),
    )
    return model(
        mesh,
        parameters=tuple(Parameter(n, v, *sorted((v / 9, v * 9))) for n, v in VALUES.items()),
        materials={"rock": material("rock", number["E"], 0.25)},
        groups=dict.fromkeys(("rock", "core", "upper"), "rock"),
        supports=rollers(2),
        in_situ=ConstantStress((number["p"], Scalar(0.7, "p"), number["p"], *(Scalar(0.0),) * 3)),
        structures={"nails": Bolts(ENDS, number["s"], EA=number["EA"])},
        stages=(
            Stage("open", excavate=("core",)),
            Stage("bolt", build=("nails",)),
            Stage("go on", excavate=("upper",)),
            Stage("cut", dismantle=("nails",)),
        ),
        channels=channels,
    )


GAUGES = (
    displacement("d", (1.0, 1.5), (1.0, 0.0)),
    cell("n1", *ENDS[0]),
    cell("n2", *ENDS[1]),
    cell("late", *ENDS[0], zero="go on"),
)
P = np.array(list(VALUES.values()))


def test_a_load_cell_reads_the_axial_force_of_its_bolt():
    survey = bolted(*GAUGES).survey(P, fields=False)
    stages = ["open", "bolt", "go on", "cut"]
    forces = survey.members.axial[:, stages.index("go on")]
    assert np.abs(forces).min() > 1.0
    np.testing.assert_allclose(survey.computed[1:3, stages.index("go on")], forces, rtol=1e-14)
    before = survey.computed[1:3, stages.index("bolt")]  # free of stress when it is built
    assert np.abs(before).max() < 1e-12 * np.abs(forces).max()


def test_it_is_read_while_the_bolt_stands():
    staged = bolted(*GAUGES)
    assert staged.unreadable("n1", "go on") is None
    assert staged.unreadable("n1", "open") == "its bolt does not stand then"
    assert staged.unreadable("n1", "cut") == "its bolt does not stand then"
    assert "later stage" in staged.unreadable("late", "bolt")


def test_forces_are_differentiated_exactly_beside_displacements():
    response = bolted(*GAUGES).response([("n1", "go on"), ("d", "go on"), ("n2", "go on")])
    assert_exact(response, P, tuple(VALUES))


def test_methods_of_unit_forces_along_readings_refuse_it():
    staged = bolted(*GAUGES)
    for why in (
        staged.response([("d", "open"), ("n1", "go on")]).obstacle(),
        staged.response([("n1", "go on")]).system_obstacle(),
    ):
        assert why == "gauge 'n1' reads something else than displacements"


def test_a_cell_between_points_without_a_bolt_is_a_fault():
    with pytest.raises(InputError) as error:
        bolted(GAUGES[0], cell("x", (1.1, 2.1), (3.6, 0.7)))
    (fault,) = error.value.faults
    assert fault.code == "no-bolt"
    assert fault.path == "gauges.x"
    assert "from (1.1, 2.1) m to (3.6, 0.7) m" in fault.message
