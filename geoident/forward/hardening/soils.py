"""Hardening soils of a case at one parameter vector, and why their numbers may be impossible."""

from __future__ import annotations

import numpy as np

from geoident.fem.yielding.hardening_law import cap_constants, cap_radius, derived
from geoident.model.case import Material
from geoident.model.dual import Dual, ParameterPoint
from geoident.model.ground import Isotropic, constants
from geoident.model.parameter import Scalar, Values
from geoident.model.yielding import HardeningSoil as GivenSoil


def soil_constants(material: Material, point: ParameterPoint) -> dict[str, Dual]:
    """The constants of the law of a material that is a hardening soil, by name.

    Args:
        material: with isotropic elasticity.
        point: the parameters.
    """
    soil, elastic = material.soil, material.elastic
    assert soil is not None
    assert isinstance(elastic, Isotropic)
    numbers = {name: point.number(scalar) for name, scalar in constants(elastic).items()}
    if "E" not in numbers:
        K, G = numbers["K"], numbers["G"]
        numbers["E"] = 9.0 * K * G / (3.0 * K + G)
        numbers["nu"] = (3.0 * K - 2.0 * G) / (2.0 * (3.0 * K + G))
    result = {name: numbers[name] for name in ("E", "nu")}
    for name in ("m", "p_ref", "Rf", "cohesion", "friction", "dilation", "tension"):
        result[name] = point.number(getattr(soil, name))
    if soil.E50 is not None:
        result["E50"] = point.number(soil.E50)
    if soil.Eoed is not None:
        result["Eoed"] = point.number(soil.Eoed)
        sine = result["friction"].sine()
        result["K0nc"] = 1.0 - sine if soil.K0nc is None else point.number(soil.K0nc)
    if soil.G0 is not None and soil.gamma_07 is not None:
        result |= {"G0": point.number(soil.G0), "gamma_07": point.number(soil.gamma_07)}
    return result


def past_stress(soil: GivenSoil, point: ParameterPoint) -> tuple[Dual, Dual] | None:
    """OCR and POP: the vertical stress was OCR s_v + POP once; None where neither is given."""
    if soil.preconsolidation_stress is not None:
        return point.constant(0.0), point.number(soil.preconsolidation_stress)
    if soil.OCR is None and soil.POP is None:
        return None
    return point.number(soil.OCR or Scalar(1.0)), point.number(soil.POP or Scalar(0.0))


def stress_at_rest(material: Material, vertical: Dual, point: ParameterPoint) -> Dual:
    """Horizontal stress (m,) of a soil of known past, effective and compression positive, Pa.

    From the highest vertical stress s_p = OCR s_v + POP, with K0nc s_p to the sides, it was
    unloaded elastically without strain to the sides, K0nc s_p - nu / (1 - nu) (s_p - s_v); not
    beyond its passive strength (theory 19).

    Args:
        material: a hardening soil.
        vertical: (m,) s_v.
        point: the parameters.
    """
    soil = material.soil
    assert soil is not None
    k = soil_constants(material, point)
    OCR, POP = past_stress(soil, point) or (point.constant(1.0), point.constant(0.0))
    sine, nu = k["friction"].sine(), k["nu"]
    highest = vertical * OCR + POP
    never = highest.value < vertical.value  # of a preconsolidation stress
    highest = Dual(np.where(never[:, None], vertical.columns, highest.columns))
    sides = highest * k.get("K0nc", 1.0 - sine) - (highest - vertical) * nu / (1.0 - nu)
    a = k["cohesion"] * k["friction"].cosine() / sine
    passive = (vertical + a) * (1.0 + sine) / (1.0 - sine) - a
    beyond = sides.value > passive.value
    return Dual(np.where(beyond[:, None], passive.columns, sides.columns))


def isotropic_past(material: Material, values: Values) -> float:
    """p_p, Pa: the same stress in all directions that is on the cap of a preconsolidation stress.

    Args:
        material: a hardening soil that has one.
        values: of the parameters.
    """
    point = ParameterPoint(values, ())
    assert material.soil is not None
    assert material.soil.preconsolidation_stress is not None
    k = soil_constants(material, point)
    numbers, alpha = derived(k), cap_constants(k)[0]
    numbers["squared"] = alpha * alpha
    upright = point.number(material.soil.preconsolidation_stress)
    sides = upright * k["K0nc"]
    past = Dual(np.stack([upright.columns, sides.columns, sides.columns])[:, None])
    return float((cap_radius(past, numbers) - numbers["a"]).value[0])


def impossible_soil(material: Material, values: Values) -> str | None:
    """Why the constants of a hardening soil do not go together, a clause, or None if they do."""
    k = soil_constants(material, ParameterPoint(values, ()))
    number = {name: float(one.value) for name, one in k.items()}
    initial = 2.0 * number.get("E50", 0.0) / (2.0 - number["Rf"])
    if not number["E"] > initial:
        return (
            f"E of {material.name}, the modulus of unloading, is {number['E']:.6g} Pa, it must be "
            f"above 2 E50 / (2 - Rf) = {initial:.6g} Pa"
        )
    unloading = 0.5 * number["E"] / (1.0 + number["nu"])
    if not number.get("G0", np.inf) > unloading:
        return (
            f"G0 of {material.name}, the shear modulus at small strains, is {number['G0']:.6g} Pa, "
            f"it must be above that of unloading, E / (2 (1 + nu)) = {unloading:.6g} Pa"
        )
    if "Eoed" not in k:
        return None
    with np.errstate(all="ignore"):
        alpha, hardening = (float(one.value) for one in cap_constants(k))
    if alpha > 0.0 and hardening > 0.0 and np.isfinite(alpha + hardening):
        return None
    return (
        f"Eoed of {material.name} is {number['Eoed']:.6g} Pa, and no cap gives it with E50 "
        f"{number['E50']:.6g} Pa, E {number['E']:.6g} Pa and K0nc {number['K0nc']:.4g}"
    )
