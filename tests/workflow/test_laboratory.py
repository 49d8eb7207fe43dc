"""Tests of soil as cases: against their closed forms, and in one fit with a site."""

import json
import re
from math import log, pi, radians, sin, sqrt

import numpy as np
import pytest
import yaml

from geoident import check, fit, fit_project
from geoident.errors import CollapseError, InputError
from geoident.io.result.file import read_result
from geoident.report.drawing.album import album
from geoident.workflow.running.jobs import build_model, load_inputs
from tests.support.derivatives import assert_exact, assert_slopes
from tests.support.pictures import laid_out

E, NU, C, PHI, PSI = 20e6, 0.3, 5e3, radians(25), radians(5)
PARAMETERS = {
    "E": {"start": "20 MPa", "bounds": ["1 MPa", "100 MPa"], "scale": "log"},
    "nu": {"start": 0.3, "bounds": [0.1, 0.45]},
    "c": {"start": "5 kPa", "bounds": ["0 kPa", "50 kPa"]},
    "phi": {"start": "25 deg", "bounds": ["10 deg", "45 deg"]},
    "psi": {"start": "5 deg", "bounds": ["0 deg", "15 deg"]},
}
YIELD = {"type": "mohr-coulomb", "cohesion": "$c", "friction": "$phi", "dilation": "$psi"}
CLAY = {"elastic": "isotropic", "E": "$E", "nu": "$nu", "yield": YIELD}
ELASTIC = {"elastic": "isotropic", "E": "20 MPa", "nu": 0.3}


def _case(folder, tests, material=CLAY, parameters=PARAMETERS):
    case = {
        "format": "geoident-case/1",
        "parameters": parameters,
        "materials": {"clay": material},
        "tests": {name: {"material": "clay", **test} for name, test in tests.items()},
    }
    path = folder / "tests.yaml"
    path.write_text(json.dumps(case))
    return str(path)


def _model(path):
    inputs = load_inputs(path)
    model = build_model(inputs)
    return model, np.array([p.start for p in inputs.case.parameters])


def _computed(path):
    """Channel and stage to what is computed at the start values, SI."""
    model, p = _model(path)
    table = model.computed(p)
    return {
        (channel.name, stage): table[i, k]
        for i, channel in enumerate(model.case.channels)
        for k, stage in enumerate(model.case.stage_names[1:])
        if np.isfinite(table[i, k])
    }


def _triaxial(cell, strains="[0.2, 3, 4, 3.9 %]", **readings):
    return {
        "kind": "triaxial",
        "cell_pressure": f"{cell} kPa",
        "readings": {"axial_strain": yaml.safe_load(strains), **readings},
        "accuracy": {"deviator_stress": "2 kPa", "volumetric_strain": "0.02 %"},
    }


OEDOMETER = {
    "kind": "oedometer",
    "seating_stress": "10 kPa",
    "readings": "rows.csv",
    "accuracy": {"axial_strain": "0.02 %"},
}
SHEAR = {
    "kind": "direct-shear",
    "readings": {"shear_strain": ["0.1 %", "10 %", "40 %", "100 %"]},
    "accuracy": {"shear_stress": "2 kPa", "vertical_strain": "0.02 %"},
}
PLATE = {
    "kind": "plate-load",
    "diameter": "300 mm",
    "overburden": "0 kPa",
    "K0": 0.5,
    "readings": {"pressure": ["100 kPa", "200 kPa"]},
    "accuracy": {"settlement": "0.05 mm"},
}
PRESSUREMETER = {
    "kind": "pressuremeter",
    "horizontal_stress": "100 kPa",
    "vertical_stress": "100 kPa",
    "readings": {"pressure": ["120 kPa", "200 kPa", "250 kPa"]},
    "accuracy": {"cavity_strain": "0.01 %"},
}


def test_triaxial_and_oedometer_of_mohr_coulomb(tmp_path, verification):
    (tmp_path / "rows.csv").write_text("vertical_stress [kPa]\n60\n210\n110\n")
    cells = (100e3, 200e3, 400e3)
    tests = {f"TX {p / 1e3:.0f}": _triaxial(p / 1e3) for p in cells}
    computed = _computed(_case(tmp_path, {**tests, "OED": OEDOMETER}))
    k = (1 + sin(PHI)) / (1 - sin(PHI))
    strength = np.array([(k - 1) * p + 2 * C * sqrt(k) for p in cells])
    names = [f"TX {p / 1e3:.0f}" for p in cells]
    found = np.array([computed[f"{name} deviator stress", f"{name} at 4 %"] for name in names])
    np.testing.assert_allclose(found, strength, rtol=1e-9)
    verification("triaxial", "strength", cells, exact=strength, found=found)
    volume = "TX 100 volumetric strain"
    assert computed["TX 100 deviator stress", "TX 100 at 0.2 %"] == pytest.approx(0.002 * E)
    assert computed[volume, "TX 100 at 0.2 %"] == pytest.approx(0.002 * (1 - 2 * NU))
    dilates = computed[volume, "TX 100 at 4 %"] - computed[volume, "TX 100 at 3 %"]
    assert dilates == pytest.approx(-0.01 * 2 * sin(PSI) / (1 - sin(PSI)))
    unloaded = computed["TX 100 deviator stress", "TX 100 at 3.9 %"]
    assert unloaded == pytest.approx(strength[0] - 0.001 * E)
    confined = E * (1 - NU) / ((1 + NU) * (1 - 2 * NU))
    loads = np.array([60e3, 210e3, 110e3])
    strains = [computed["OED axial strain", f"OED at {p / 1e3:.0f} kPa"] for p in loads]
    np.testing.assert_allclose(strains, (loads - 10e3) / confined, rtol=1e-9)
    # a test is not read in the stages of another
    assert all(stage.startswith(channel[:3]) for channel, stage in computed)


def _undrained(cell, strains="[0.2, 3, 4 %]"):
    accuracy = {"deviator_stress": "2 kPa", "pore_pressure": "1 kPa"}
    return {**_triaxial(cell, strains), "drainage": "undrained", "accuracy": accuracy}


AIR = {"hydraulic": {"permeability": "1e-9 m/s", "storage": "1e-8 1/Pa"}}
"""Water with air in it, which gives way by a sixth of what the skeleton does."""


@pytest.mark.parametrize("water", [{}, AIR], ids=["water", "air"])
def test_undrained_triaxial_of_mohr_coulomb(tmp_path, verification, water):
    """Skempton's A is 1/3 of elastic ground, B = 1 / (1 + K S); p' tells the strength then.

    Without dilation and with water that hardly gives way p' stays what it was. The material need
    not have `hydraulic`; if it has, what it stores counts.
    """
    cells = np.array([100e3, 200e3, 400e3])
    names = [f"CU {p / 1e3:.0f}" for p in cells]
    tests = {name: _undrained(p / 1e3) for name, p in zip(names, cells, strict=True)}
    material = {**CLAY, **water, "yield": {**YIELD, "dilation": "0 deg"}}
    parameters = {name: one for name, one in PARAMETERS.items() if name != "psi"}
    computed = _computed(_case(tmp_path, {**tests, "CD": _triaxial(100)}, material, parameters))
    k = (1 + sin(PHI)) / (1 - sin(PHI))
    gives = E / (3 * (1 - 2 * NU)) * (1e-8 if water else 0.4 / 2.2e9)
    b = 1 / (1 + gives)  # Skempton's B
    # q (2 + k) / 3 = (k - 1) p' + 2 c sqrt(k) with p' = cell + gives * u, u = B q / 3
    strength = ((k - 1) * cells + 2 * C * sqrt(k)) / ((2 + k - (k - 1) * b * gives) / 3)
    found = np.array([computed[f"{n} deviator stress", f"{n} at 4 %"] for n in names])
    np.testing.assert_allclose(found, strength, rtol=1e-8)
    for name in names:
        for row in ("0.2 %", "3 %", "4 %"):
            q = computed[f"{name} deviator stress", f"{name} at {row}"]
            u = computed[f"{name} pore pressure", f"{name} at {row}"]
            assert u == pytest.approx(b * q / 3, rel=1e-8)
    q = computed["CU 400 deviator stress", "CU 400 at 0.2 %"]
    assert q == pytest.approx(1.5 * E / (1 + NU) * (0.002 - b * q / 3 * gives * (1 - 2 * NU) / E))
    variant = "water with air" if water else "water alone"
    verification("triaxial-undrained", variant, cells, exact=strength, found=found)
    drained = (k - 1) * 100e3 + 2 * C * sqrt(k)  # beside them, of the same material
    assert computed["CD deviator stress", "CD at 4 %"] == pytest.approx(drained)


def test_blank_cells_were_not_read(tmp_path):
    """In a table and in a list of the case, whose numbers take the unit of its last value."""
    (tmp_path / "tx.csv").write_text(
        "axial_strain [%], deviator_stress [kPa], volumetric_strain [%]\n"
        "1, 150,\n2, , 0.3\n3, 160\n"
    )
    table = {**_triaxial(100), "readings": "tx.csv"}
    listed = _triaxial(200, strains="[1, 2, 3 %]", deviator_stress=["150", "250 kPa", None])
    case = load_inputs(_case(tmp_path, {"TX 1": table, "TX 2": listed})).case
    read = {(one.channel, one.stage): one.value for one in case.readings}
    assert read == {
        ("TX 1 deviator stress", "TX 1 at 1 %"): 150e3,
        ("TX 1 deviator stress", "TX 1 at 3 %"): 160e3,
        ("TX 1 volumetric strain", "TX 1 at 2 %"): pytest.approx(0.003),
        ("TX 2 deviator stress", "TX 2 at 1 %"): 150e3,
        ("TX 2 deviator stress", "TX 2 at 2 %"): 250e3,
    }


def test_simulated_rows_take_the_place_of_those_that_were_read(tmp_path):
    """By an override; written beside the tests they are refused."""
    path = _case(tmp_path, {"TX 1": _triaxial(100, deviator_stress=["1", "2", "3", "4 kPa"])})
    (tmp_path / "trial.csv").write_text(
        "gauge,stage,value,unit\nTX 1 deviator stress,TX 1 at 3 %,150,kPa\n"
    )
    (read,) = load_inputs(path, overrides=["readings=trial.csv"]).case.readings
    assert (read.stage, read.value) == ("TX 1 at 3 %", 150e3)
    (tmp_path / "tests.yaml").write_text(
        json.dumps({**json.loads((tmp_path / "tests.yaml").read_text()), "readings": "trial.csv"})
    )
    with pytest.raises(InputError, match="by an override"):
        load_inputs(path)


def test_a_backtest_of_tests_is_made_where_it_is_asked_for(tmp_path):
    path = _case(tmp_path, {"TX 1": _triaxial(100, deviator_stress=["1", "2", "3", "4 kPa"])})
    for overrides, asked in ([], False), (["fit.backtest=true"], True):
        assert load_inputs(path, overrides=overrides).case.fit.backtest is asked


def test_shear_box_reaches_the_strength_of_simple_shear(tmp_path, verification):
    """E. H. Davis (1968): tau = sigma sin(phi) cos(psi) / (1 - sin(phi) sin(psi)) without c."""
    tests = {f"DS {p}": {**SHEAR, "normal_stress": f"{p} kPa"} for p in (50, 100, 200)}
    material = {**CLAY, "yield": {**YIELD, "cohesion": "0 kPa"}}
    parameters = {name: one for name, one in PARAMETERS.items() if name != "c"}
    computed = _computed(_case(tmp_path, tests, material, parameters))
    normal = np.array([50e3, 100e3, 200e3])
    exact = normal * sin(PHI) * np.cos(PSI) / (1 - sin(PHI) * sin(PSI))
    names = [f"DS {p / 1e3:.0f}" for p in normal]
    found = np.array([computed[f"{name} shear stress.xy", f"{name} at 100 %"] for name in names])
    np.testing.assert_allclose(found, exact, rtol=2e-3)
    verification("direct-shear", "strength", normal, exact=exact, found=found)
    assert computed["DS 100 shear stress.xy", "DS 100 at 0.1 %"] == pytest.approx(
        0.001 * E / (2 * (1 + NU))
    )


def test_plates_on_elastic_ground(tmp_path, verification):
    a, q, shear = 0.15, 100e3, E / (2 * (1 + NU))
    exact = {
        "flexible": 2 * (1 - NU**2) * q * a / E,
        # V. I. Mossakovskii (1954), bonded
        "rigid": q * pi * a * (1 - 2 * NU) / (4 * shear * log(3 - 4 * NU)),
    }
    found = {}
    for plate, settlement in exact.items():
        path = _case(tmp_path, {"PL": {**PLATE, "plate": plate}}, ELASTIC, {})
        found[plate] = _computed(path)["PL settlement", "PL at 100 kPa"]
        assert found[plate] == pytest.approx(settlement, rel=5e-3)
    numbers = {"exact": list(exact.values()), "found": list(found.values())}
    verification("plate-load", "settlement", list(exact), **numbers)


@pytest.mark.slow
def test_a_row_beyond_the_strength_is_named(tmp_path):
    """A flexible plate on clay carries 5.14 to 6.05 times its strength (Cox et al. 1961: 5.69)."""
    material = {**ELASTIC, "nu": 0.4, "yield": {"type": "tresca", "cohesion": "5 kPa"}}
    rows = {"pressure": ["20 kPa", "50 kPa", "90 kPa"]}
    test = {**PLATE, "K0": 1, "plate": "flexible", "readings": rows}
    model, p = _model(_case(tmp_path, {"PL": test}, material, {}))
    with pytest.raises(CollapseError, match="stage 'PL at 50 kPa'") as found:
        model.survey(p, fields=False)
    assert "leave out this row and those after it" in found.value.hint
    assert 5.14 < (20 + 30 * found.value.fraction) / 5 < 6.05


def test_pressuremeter_in_clay(tmp_path, verification):
    """R. E. Gibson & W. F. Anderson (1961): p = p0 + s [1 + ln(2 G eps / s)], nu = 0.5."""
    s, nu, shear = 50e3, 0.495, 20e6 / (2 * 1.495)
    material = {**ELASTIC, "nu": nu, "yield": {"type": "tresca", "cohesion": "50 kPa"}}
    computed = _computed(_case(tmp_path, {"PM": PRESSUREMETER}, material, {}))
    pressures = np.array([120e3, 200e3, 250e3])
    grown = s / (2 * shear) * np.exp((pressures - 100e3) / s - 1)
    exact = np.where(pressures < 150e3, (pressures - 100e3) / (2 * shear), grown)
    found = np.array([computed["PM cavity strain", f"PM at {p / 1e3:.0f} kPa"] for p in pressures])
    np.testing.assert_allclose(found, exact, rtol=0.02)
    assert found[0] == pytest.approx(exact[0], rel=1e-3)
    verification("pressuremeter", "cavity strain", pressures, exact=exact, found=found)


def test_derivatives_of_tests(tmp_path):
    (tmp_path / "rows.csv").write_text("vertical_stress [kPa]\n60\n210\n110\n")
    tests = {"TX 100": _triaxial(100, strains="[0.2, 3 %]"), "OED": OEDOMETER}
    tests["CU 100"] = _undrained(100, strains="[0.2, 3 %]")
    model, p = _model(_case(tmp_path, tests))
    places = model.readable_until(len(model.bases) - 1)
    pairs = [
        (model.case.channels[row].name, model.case.stage_names[state])
        for row, state in zip(places.rows, places.states, strict=True)
    ]
    response, accuracy = model.response(pairs), {c.name: c.accuracy for c in model.case.channels}
    sd = np.array([accuracy[channel] for channel, _ in pairs])  # strains beside stresses
    jacobian = response.evaluate(p)[1]
    assert np.all(np.abs(jacobian).max(axis=0) > 0)
    slopes = jacobian / sd[:, None]
    assert_slopes(lambda p: response.readings(p) / sd, p, slopes, model.names, step=2e-3)


def test_derivative_by_the_stress_in_situ(tmp_path):
    parameters = {"s": {"start": "100 kPa", "bounds": ["50 kPa", "110 kPa"]}} | PARAMETERS
    test = {**PRESSUREMETER, "horizontal_stress": "$s"}
    model, p = _model(_case(tmp_path, {"PM": test}, CLAY, parameters))
    pairs = [("PM cavity strain", f"PM at {n} kPa") for n in (120, 200, 250)]
    assert_exact(model.response(pairs), p, model.names, step=5e-4)


@pytest.mark.slow
def test_fit_of_hardening_soil_finds_the_constants_of_published_tests(tmp_path):
    """Loose Hostun sand of Schanz, Vermeer & Bonnier (1999): E50 20 MPa, Eoed 16 MPa, phi 34 deg.

    Triaxial tests: strains and volumes that the report of ConstitutiveModels gives for half of the
    strength (secant modulus 33.45 MPa) and for failure, q / cell pressure 2.537; oedometer: the
    strains that follow from Eoed (sigma / p_ref)^m, 1.821 % between 2 and 200 kPa in the report.
    """
    parameters = {
        "E50": {"start": "30 MPa", "bounds": ["5 MPa", "100 MPa"], "scale": "log"},
        "Eoed": {"start": "25 MPa", "bounds": ["5 MPa", "100 MPa"], "scale": "log"},
        "phi": {"start": "36 deg", "bounds": ["25 deg", "45 deg"]},
    }
    law = {"type": "hardening-soil", "E50": "$E50", "Eoed": "$Eoed", "m": 0.65, "K0nc": 0.4408}
    law |= {"cohesion": "0 kPa", "friction": "$phi", "dilation": "0 deg"}
    half = 0.5 * 2.537 * 300
    tests = {
        "TX 300": _triaxial(
            300,
            strains=f"[{half / 334.5:.4f}, 10.7 %]",
            deviator_stress=[half, "761.1 kPa"],
            volumetric_strain=[None, "0.97 %"],
        ),
        "TX 600": _triaxial(
            600, strains="[13.6 %]", deviator_stress=["1522.2 kPa"], volumetric_strain=["1.24 %"]
        ),
        "OED": {
            **OEDOMETER,
            "seating_stress": "2 kPa",
            "readings": {
                "vertical_stress": [50, 100, "200 kPa"],
                "axial_strain": [0.9469, 1.3316, "1.821 %"],
            },
        },
    }
    for cell in (300, 600):
        accuracy = {"deviator_stress": f"{8 * cell / 300} kPa", "volumetric_strain": "0.03 %"}
        tests[f"TX {cell}"]["accuracy"] = accuracy
    sand = {"E": "60 MPa", "nu": 0.2, "yield": law}
    found = fit(_case(tmp_path, tests, sand, parameters)).parameters
    for name, truth in {"E50": 20e6, "Eoed": 16e6, "phi": np.radians(34.0)}.items():
        assert found[name].lower95 < truth < found[name].upper95
        assert found[name].value == pytest.approx(truth, rel=0.05)


SAND = {
    "E": "60 MPa",
    "nu": 0.2,
    "yield": {
        "type": "hardening-soil", "E50": "20 MPa", "Eoed": "16 MPa", "m": 0.65, "K0nc": 0.4408,
        "cohesion": "0 kPa", "friction": "34 deg", "dilation": "0 deg",
    },
}  # fmt: skip
"""Loose Hostun sand of Schanz, Vermeer & Bonnier (1999)."""


def test_the_oedometer_curve_bends_at_the_preconsolidation_stress(tmp_path, verification):
    """Elastic first, by E (s_3 / p_ref)^m, then a first loading by Eoed (s / p_ref)^m.

    With nu / (1 - nu) = K0nc the specimen comes to the stress of its past as it was there.
    """
    K0, nu, m = 0.4408, 0.4408 / 1.4408, 0.65
    loads = np.array([2, 20, 100, 200, 220, 300])
    (tmp_path / "rows.csv").write_text("\n".join(["vertical_stress [kPa]", *map(str, loads[1:])]))
    test = {**OEDOMETER, "seating_stress": "2 kPa", "preconsolidation_stress": "200 kPa"}
    computed = _computed(_case(tmp_path, {"OED": test}, {**SAND, "nu": nu}, {}))
    found = [computed["OED axial strain", f"OED at {load} kPa"] for load in loads[1:]]
    sides = 2 + K0 * (loads - 2)
    reloaded = (1 + nu) * (1 - 2 * nu) / (1 - nu) / (60e3 * (1 - m) * K0) * 1e2**m
    exact = reloaded * (sides**0.35 - 2**0.35)
    exact[4:] = exact[3] + (loads[4:] ** 0.35 - 200**0.35) * 1e2**m / (16e3 * (1 - m))
    np.testing.assert_allclose(found, exact[1:], rtol=2e-3)
    assert found[4] - found[3] == pytest.approx(exact[5] - exact[4], rel=1e-3)
    verification("preconsolidation", "", 1e3 * loads[1:], exact=exact[1:], found=found)


def test_samples_have_their_own_past_and_yield_all_around_where_check_says(tmp_path):
    """Each stress of the past is a material; its volume follows E (p / p_ref)^m up to p_p."""
    parameters = {"sigma_p": {"start": "100 kPa", "bounds": ["20 kPa", "400 kPa"]}}
    pasts = {"TX 1": "$sigma_p", "TX 2": "200 kPa", "TX 3": "$sigma_p"}
    tests = {n: {**_triaxial(90), "preconsolidation_stress": past} for n, past in pasts.items()}
    words = " ".join(str(check(_case(tmp_path, tests, SAND, parameters))).split())
    found = re.findall(
        r"'clay, once under (\S+(?: kPa)?)' once bore (\S+) kPa .*? above (\S+)", words
    )
    assert [one[:2] for one in found] == [("$sigma_p", "100"), ("200 kPa", "200")]
    p_p = float(found[1][2])
    law = {**SAND["yield"], "preconsolidation_stress": "200 kPa"}
    case = {
        "format": "geoident-case/1",
        "analysis": "axisymmetric",
        "mesh": {"file": "geoident:specimen"},
        "materials": {"sand": {**SAND, "yield": law}},
        "groups": {"specimen": "sand"},
        "supports": {"bottom": "y"},
        "in_situ": {"model": "constant", **dict.fromkeys(("xx", "yy", "zz"), "-20 kPa")},
        "stages": [
            {
                "name": f"{p / p_p:.1f}",
                "loads": {on: {"on": on, "pressure": f"{p - 20} kPa"} for on in ("side", "top")},
            }
            for p in (p_p, 1.1 * p_p)
        ],
        "gauges": {
            "V": {
                "kind": "strain", "point": ["0.5 m", "0.5 m"], "component": "volume",
                "positive": "compression", "accuracy": "0.01 %",
            }
        },
    }  # fmt: skip
    (tmp_path / "case.yaml").write_text(json.dumps(case))
    computed = _computed(tmp_path / "case.yaml")
    volume = 3 * 0.6 / 60e3 * 1e2**0.65 / 0.35 * np.diff(np.array([20, p_p, 1.1 * p_p]) ** 0.35)
    assert computed["V", "1.0"] == pytest.approx(volume[0], rel=1e-3)
    assert computed["V", "1.1"] - computed["V", "1.0"] > 2 * volume[1]


@pytest.mark.slow
def test_derivatives_by_the_preconsolidation_stress(tmp_path):
    parameters = {
        "sigma_p": {"start": "150 kPa", "bounds": ["20 kPa", "400 kPa"]},
        "K0nc": {"start": 0.44, "bounds": [0.3, 0.6]},
    }
    tests = {
        "TX 50": _triaxial(50, "[0.1, 1 %]"),
        "OED": {**OEDOMETER, "readings": {"vertical_stress": ["60 kPa", "240 kPa"]}},
    }
    tests = {n: {**test, "preconsolidation_stress": "$sigma_p"} for n, test in tests.items()}
    material = {**SAND, "yield": {**SAND["yield"], "K0nc": "$K0nc"}}
    model, p = _model(_case(tmp_path, tests, material, parameters))
    pairs = [("OED axial strain", "OED at 240 kPa")]
    pairs += [
        (f"TX 50 {column}", f"TX 50 at {row} %")
        for column in ("deviator stress", "volumetric strain")
        for row in ("0.1", "1")
    ]
    response, accuracy = model.response(pairs), {c.name: c.accuracy for c in model.case.channels}
    sd = np.array([accuracy[channel] for channel, _ in pairs])
    slopes = response.evaluate(p)[1] / sd[:, None]
    assert_slopes(lambda p: response.readings(p) / sd, p, slopes, model.names, step=1e-3)


def test_result_of_tests_is_drawn_over_what_was_imposed(tmp_path):
    """Not over stages, and without the fields of a specimen of unit size."""
    confined = E * (1 - NU) / ((1 + NU) * (1 - 2 * NU)) / 1e3
    (tmp_path / "rows.csv").write_text(
        "Axial strain [mm/m], vertical_stress [kPa]\n"
        f"{100e3 / confined}, 110\n, 310\n{200e3 / confined}, 210\n"
    )
    tests = {
        f"TX {p}": _triaxial(p, "[0.5, 1 %]", deviator_stress=[100, "200 kPa"]) for p in (1, 2)
    }
    parameters = {"E": PARAMETERS["E"]}
    path = _case(tmp_path, {**tests, "OED": OEDOMETER}, {**ELASTIC, "E": "$E"}, parameters)
    fit(path)
    result = read_result(str(tmp_path / "tests.fit.h5"))
    assert (result.fields, result.reactions, result.yielded) == (None, None, None)
    pictures = album(result)
    (picture,) = pictures.overview
    assert not pictures.model + pictures.readings + pictures.fields
    q, volume, settled = laid_out(picture.draw).axes
    assert [text.get_text() for text in q.get_legend().get_texts()] == ["TX 1", "TX 2"]
    assert (q.get_xlabel(), q.get_ylabel()) == ("axial strain (%)", "deviator stress (kPa)")
    assert (settled.get_xscale(), settled.yaxis_inverted()) == ("log", True)
    drawn = [line.get_xydata() for line in q.get_lines() if line.get_linestyle() == "-"]
    of_1 = next(xy[np.isfinite(xy).all(axis=1)] for xy in drawn if len(xy) > 3)
    np.testing.assert_allclose(of_1, [[0.0, 0.0], [0.5, 100.0], [1.0, 200.0]], atol=1e-4)
    (dots,) = (line for line in settled.get_lines() if line.get_marker() == "o")
    np.testing.assert_allclose(dots.get_xdata(), [110.0, 210.0])  # 310 kPa was not read
    assert volume.get_ylabel().startswith("volumetric strain")


SITE = """\
format: geoident-case/1
analysis: axisymmetric
mesh: {file: "geoident:specimen"}
parameters:
  E: {start: 15 MPa, bounds: [1 MPa, 100 MPa], scale: log}
  c: {start: 10 kPa, bounds: [0 kPa, 50 kPa]}
  phi: {start: 28 deg, bounds: [15 deg, 45 deg]}
materials:
  clay:
    elastic: isotropic
    E: $E
    nu: 0.3
    yield: {type: mohr-coulomb, cohesion: $c, friction: $phi, dilation: 5 deg}
groups: {specimen: clay}
supports: {bottom: y, side: x}
in_situ: {model: constant, xx: -50 kPa, yy: -100 kPa, zz: -50 kPa, held: false}
loads: {fill: {on: top, pressure: 100 kPa}}
stages:
  - {name: first lift, loads: {fill: {on: top, pressure: 200 kPa}}}
  - {name: second lift, loads: {fill: {on: top, pressure: 300 kPa}}}
gauges:
  S: {kind: settlement, point: [0.5, 1 m], accuracy: 0.1 mm}
readings:
  - {gauge: S, stage: first lift, value: 3.71 mm}
  - {gauge: S, stage: second lift, value: 7.43 mm}
"""


@pytest.mark.slow
def test_site_and_laboratory_in_one_fit(tmp_path):
    """The site tells the modulus, the laboratory the strength, which the site does not reach."""
    k = (1 + sin(PHI)) / (1 - sin(PHI))
    tests = {
        f"TX {p}": {
            **_triaxial(p, strains="[3, 4 %]", deviator_stress=[f"{q:.2f} kPa"] * 2),
            "accuracy": {"deviator_stress": "2 kPa"},
        }
        for p in (100, 400)
        for q in ((k - 1) * p + 2 * C / 1e3 * sqrt(k),)
    }
    names = ("E", "c", "phi")
    parameters = yaml.safe_load(SITE)["parameters"]
    material = {**CLAY, "nu": 0.3, "yield": {**YIELD, "dilation": "5 deg"}}
    _case(tmp_path, tests, material, parameters)
    (tmp_path / "site.yaml").write_text(SITE)
    project = {
        "format": "geoident-project/1",
        "sections": [
            {"name": "site", "case": "site.yaml"},
            {"name": "tests", "case": "tests.yaml"},
        ],
        "shared": list(names),
    }
    (tmp_path / "project.yaml").write_text(json.dumps(project))
    result = fit_project(tmp_path / "project.yaml")
    found = [result.common[name] for name in names]
    for one, truth in zip(found, (E, C, PHI), strict=True):
        assert one.lower95 < truth < one.upper95
        assert one.value == pytest.approx(truth, rel=0.02)
