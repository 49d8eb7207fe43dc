"""Intervals contain the choice between profiles where these are averaged by uncertain weights."""

from __future__ import annotations

import json

import numpy as np
import pytest
from support.cases import material
from support.derivatives import assert_slopes
from support.yielding import mohr, parameters, rock

from geoident.model.parameter import Scalar
from tests.support.commands import run_command

from .test_advance import DISTANCES, WALL, profile, stages
from .test_opening_model import MPa, without_mesh

P0, NU, R, TRUE_E = 9e6, 0.25, 3.0, 2e9
AWAY = (2.0, 5.0, 11.0, 23.0)
SHARES = {  # of elastic ground, R* = 1, written out
    "vlachopoulos-diederichs": lambda x: 1 - (1 - np.exp(-0.15) / 3) * np.exp(-1.5 * x),
    "panet": lambda x: 0.25 + 0.75 * (1 - (0.75 / (0.75 + x)) ** 2),
    "chern": lambda x: (1 + np.exp(-x / 1.10)) ** -1.7,
}
AVERAGED = "{profile: vlachopoulos-diederichs, averaged_with: {panet: $w_panet, chern: $w_chern}}"
WEIGHT = "{start: 0.333, bounds: [-0.6, 1.6], prior: {mean: 0.333, sd: 0.47}}"


def case_text(face: str, truth: str, *weights: str) -> str:
    """Convergence of an elastic wall that moves by a profile, read to 0.1 mm."""
    share = SHARES[truth](np.array(AWAY) / R)
    moved = -2e3 * (share - share[0]) * P0 * R * (1 + NU) / TRUE_E
    lines = [
        "format: geoident-case/1",
        "analysis: plane-strain",
        "parameters:",
        "  E: {start: 3 GPa, bounds: [0.2 GPa, 40 GPa], scale: log}",
        *(f"  {name}: {WEIGHT}" for name in weights),
        f"materials: {{rock: {{E: $E, nu: {NU}}}}}",
        "groups: {rock: rock, tunnel: rock}",
        "in_situ: {model: heim, vertical: 9 MPa, K0: 1.0}",
        f"face: {face}",
        "stages:",
        *(
            f"  - {{name: s{n}, distance: {x} m{', excavate: [tunnel]' * (n == 0)}}}"
            for n, x in enumerate(AWAY)
        ),
        "gauges:",
        "  CV: {kind: convergence, between: [[-3, 0 m], [3, 0 m]], accuracy: 0.1 mm, zero: s0}",
        "readings:",
        *(
            f"  - {{gauge: CV, stage: s{n}, value: {value:.1f} mm}}"
            for n, value in enumerate(moved[1:], start=1)
        ),
        "fit: {method: closed-form, closed-form: {centre: [0, 0 m], radius: 3 m, starts: 1}}",
    ]
    return "\n".join(lines) + "\n"


def interval(folder, text: str) -> tuple[float, float]:
    path = folder / "case.yaml"
    path.write_text(text)
    run = run_command("fit", path, "--json", "-q", "--force")
    found = json.loads(run.stdout)["parameters"]["E"]
    return found["lower95"], found["upper95"]


@pytest.mark.parametrize("truth", SHARES)
def test_an_average_contains_the_truth_whichever_profile_is_right(tmp_path, truth):
    """One wrong profile is sure of a wrong modulus."""
    low, high = interval(tmp_path, case_text(AVERAGED, truth, "w_panet", "w_chern"))
    assert low < TRUE_E < high
    for wrong in SHARES.keys() - {truth}:
        low, high = interval(tmp_path, case_text(f"{{profile: {wrong}}}", truth))
        assert not low < TRUE_E < high, wrong


def test_the_share_is_the_weighted_sum_and_stays_from_0_to_1():
    others = (profile("panet"), Scalar(0.5)), (profile("chern"), Scalar(0.2))
    face = profile("vlachopoulos-diederichs", averaged=others)
    opened = without_mesh(material("rock", 5e9, 0.25), face=face, stages=stages((1.0, 5.0)))
    x = np.array([1.0, 5.0]) / 2.0
    weights = {"vlachopoulos-diederichs": 0.3, "panet": 0.5, "chern": 0.2}
    expected = sum(w * SHARES[law](x) for law, w in weights.items())
    found = [state.share for state in opened.face_states({})]
    np.testing.assert_allclose(found, expected, rtol=1e-12)
    (text,) = (note for note in opened.notes if "average" in note and "release" in note)
    assert "Diederichs (30 %), Panet's profile (50 %) and Chern's profile (20 %)" in text
    (text,) = (note for note in opened.notes if "intervals take the profile as known" in note)
    assert "prior: {mean: 0.333, sd: 0.47}" in text

    for weight, end in ((9.0, 1.0), (-19.0, 0.0)):
        far = profile("vlachopoulos-diederichs", averaged=((profile("panet"), Scalar(weight)),))
        opened = without_mesh(material("rock", 5e9, 0.25), face=far, stages=stages((1.0,)))
        assert [state.share for state in opened.face_states({})] == [end]


def test_derivatives_by_weights_are_exact_where_the_ground_yields():
    values = {"w_panet": 0.4, "w_chern": 0.3, "c": 1.0 * MPa}
    tied = {name: Scalar(1.0, name) for name in values}
    others = (profile("panet"), tied["w_panet"]), (profile("chern"), tied["w_chern"])
    opened = without_mesh(
        rock(5e9, 0.25, mohr(tied["c"], 0.5)),
        face=profile("vlachopoulos-diederichs", averaged=others),
        parameters=parameters(**values),
        stages=stages(DISTANCES[1:]),
        channels=(WALL,),
    )
    response = opened.response([("wall", str(n)) for n in range(len(DISTANCES) - 1)])
    p = np.array([*values.values()])
    _, jacobian = response.evaluate(p)
    assert (np.abs(jacobian).max(axis=0) > 0.0).all()
    assert_slopes(response.readings, p, jacobian, tuple(values), step=1e-4, rtol=1e-6)
