"""Hardening soil beside interfaces, structures and other ground that yield: exact derivatives."""

from __future__ import annotations

from dataclasses import replace
from math import radians

import numpy as np
import pytest

from geoident.model.actions import Traction
from geoident.model.case import Stage, Support
from geoident.model.in_situ import ConstantStress, GeostaticStress
from geoident.model.interfaces import Interface
from geoident.model.parameter import Parameter, Scalar
from geoident.model.structures import SectionLimits
from geoident.model.yielding import HardeningSoil, MohrCoulomb
from tests.forward.structures.test_beams_between_interfaces import STARTS, pit, slips
from tests.forward.structures.test_interfaces import meter, on_level
from tests.support.cases import material, model
from tests.support.derivatives import assert_slopes
from tests.support.meshes import box

ZERO = Scalar(0.0)
SOIL = {"E50": 1.2e7, "Eur": 3.6e7, "cohesion": 6e3, "friction": radians(30)}


def hardening():
    """A hardening soil with its parameters."""
    one = {name: Scalar(1.0, name) for name in SOIL}
    law = HardeningSoil(
        E50=one["E50"], m=Scalar(0.5), p_ref=Scalar(1e5), Rf=Scalar(0.9), cohesion=one["cohesion"],
        friction=one["friction"], dilation=Scalar(radians(2)), tension=ZERO,
        Eoed=Scalar(1.0, "E50"), OCR=Scalar(1.5),
    )  # fmt: skip
    return replace(material("soil", one["Eur"], 0.2, 1900.0), soil=law)


def test_ground_at_its_passive_limit_beside_an_interface():
    """At rest after a high past: the step to equilibrium moves it a little beyond."""
    soil = hardening()
    assert soil.soil is not None
    soil = replace(soil, soil=replace(soil.soil, OCR=None, POP=Scalar(1.2e5)))
    staged = pit(
        "quad8", interface=slips(), soil=soil, low=soil, numbers=SOIL, in_situ=GeostaticStress()
    )
    survey = staged.survey(np.array([*STARTS.values(), *SOIL.values()]), fields=False)
    assert np.isfinite(survey.computed[0]).all()


@pytest.mark.slow
def test_derivatives_of_a_block_that_rocks_and_slides():
    """By all constants of soil and interface, which yields at one end, part by part."""
    starts = SOIL | {"k_n": 5e8, "k_s": 2e7, "c": 4e3, "phi": radians(22), "psi": radians(5)}
    one = {name: Scalar(1.0, name) for name in starts}
    staged = model(
        on_level(box("quad8", (1, 2)), 0.5),
        materials={"soil": replace(hardening(), density=ZERO), "rock": material("rock", 1e9, 0.2)},
        groups={"rock": "soil", "low": "rock"},
        supports=(Support("y0", (0, 1)),),
        in_situ=ConstantStress(
            (Scalar(-6e4), Scalar(-1e5), Scalar(-6e4), ZERO, ZERO, ZERO), held=True
        ),
        parameters=tuple(Parameter(n, v, 0.1 * v, 10 * v) for n, v in starts.items()),
        interfaces={
            "joint": Interface(
                "joint", one["k_n"], one["k_s"], one["c"], one["phi"], dilation=one["psi"]
            )
        },
        stages=tuple(
            Stage(f"push {n}", loads={"p": Traction("y1", (Scalar(push), Scalar(1e3)))})
            for n, push in enumerate((2e4, 3.3e4))
        ),
        channels=tuple(meter(what, (0.5, 0.5), what) for what in ("slip", "opening")),
    )
    start = np.array(list(starts.values()))
    response = staged.response(
        [(c.name, f"push {n}") for c in staged.case.channels for n in range(2)]
    )
    v, jacobian = response.evaluate(start)
    assert v[:2] == pytest.approx([-2e4 / 2e7, -3.3e4 / 2e7], rel=0.2)
    assert (np.abs(jacobian * start).max(axis=0) > 1e-6).all()
    assert_slopes(response.readings, start, jacobian, tuple(starts), step=2e-4)


SECTION = {"bends": 4e3, "strut": 3e4}
LOW = {"c_low": 2e3, "phi_low": radians(19)}


@pytest.mark.slow
@pytest.mark.parametrize("what", ["interfaces", "wall", "ground", "ground that dilates less"])
def test_derivatives_in_a_pit(what):
    """A wall that slips; one that yields, with its strut; Mohr-Coulomb below."""
    soil, numbers, more = hardening(), dict(SOIL), {}
    if what == "wall":
        numbers |= SECTION
        more = {"limits": SectionLimits(M=Scalar(1.0, "bends")), "capacity": Scalar(1.0, "strut")}
    if what.startswith("ground"):
        numbers |= LOW
        c, phi = (Scalar(1.0, name) for name in LOW)
        low = material("stiff", Scalar(1.0, "E"), 0.3, 1900.0)
        more = {
            "low": replace(
                low, yields=(MohrCoulomb(c, phi, phi if what == "ground" else Scalar(radians(5))),)
            )
        }
    staged = pit("quad4", interface=slips(), soil=soil, numbers=numbers, **more)
    start = np.array([*STARTS.values(), *numbers.values()])
    pairs = [(c.name, s) for c in staged.case.channels for s in staged.case.stage_names[2:]]
    response = staged.response(pairs)
    v, jacobian = response.evaluate(start)
    np.testing.assert_allclose(response.readings(start), v, rtol=1e-9)
    acts = np.abs(jacobian * start).max(axis=0) > 0
    assert acts.all(), [*STARTS, *numbers]
    assert_slopes(response.readings, start, jacobian, (*STARTS, *numbers), step=2e-4)
