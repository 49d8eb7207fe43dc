"""Tables of interfaces against closed forms: tractions, jumps, how much of them slips and opens."""

from __future__ import annotations

from math import sqrt, tanh

import numpy as np
import pytest

from geoident.model.actions import PointForce
from geoident.model.case import Stage, Support
from geoident.model.interfaces import Interface
from geoident.model.parameter import Scalar
from tests.forward.structures.test_interfaces import (
    BOND,
    MODULUS,
    NOTHING,
    RIGID,
    STRIP,
    THICK,
    ZERO,
    bonded_strip,
    on_level,
)
from tests.support.cases import model
from tests.support.meshes import box


def test_the_part_of_a_bond_that_slips():
    """A strip of limited bond, pulled with tau a + what the rest holds, slips along a."""
    bond, slid = 1e5, 0.8
    rate = sqrt(BOND / (MODULUS * THICK))
    pull = bond / rate * tanh(rate * (STRIP - slid)) + bond * slid
    limits = {"cohesion": Scalar(bond), "friction": ZERO, "tensile_strength": Scalar(1e9)}
    states = bonded_strip(pull, **limits).survey(NOTHING, fields=False).interfaces
    assert states.areas @ states.slips[:, 0] == pytest.approx(slid, abs=STRIP / 60)
    assert np.abs(states.shear_traction[states.slips[:, 0], 0]) == pytest.approx(bond)
    assert not states.parts.any()


def test_the_part_of_a_base_that_opens():
    """A rigid block under a force at e > b / 6 rests on 3 (b / 2 - e), its edge on 2 N / that."""
    force, off = 3e5, 0.25
    staged = model(
        on_level(box("quad4", (80, 2), size=(1.0, 0.2)), 0.1),
        materials={"stone": RIGID},
        groups={"rock": "stone", "low": "stone"},
        supports=(Support("y0", (0, 1)),),
        interfaces={
            "joint": Interface(
                "joint", Scalar(1e9), Scalar(1e9), cohesion=Scalar(1e9), friction=ZERO
            )
        },
        stages=(Stage("press", loads={"N": PointForce((0.5 + off, 0.2), (ZERO, Scalar(-force)))}),),
    )
    states = staged.survey(NOTHING, fields=False).interfaces
    rests = 3.0 * (0.5 - off)
    assert states.areas @ states.parts[:, 0] == pytest.approx(1.0 - rests, abs=1 / 80)
    assert states.normal_traction.min() == pytest.approx(-2.0 * force / rests, rel=2e-3)
    edge = states.opening[states.points[:, 0] < 1e-9, 0]  # turns about the end of the contact
    expected = 2.0 * force / rests / 1e9 / rests * (1.0 - rests)
    assert edge == pytest.approx(expected, rel=5e-3)
    assert not states.slips.any()
