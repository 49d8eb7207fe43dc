"""Whether predicted stages load elastic ground more than the fitted ones did."""

from dataclasses import replace

import numpy as np
import pytest

from geoident.model.gauges import Channel
from geoident.model.results.findings import sentences_of
from geoident.workflow.fit import fit
from geoident.workflow.running.control import Control
from geoident.workflow.running.jobs import Request, build_model, load_inputs, plan_fit
from geoident.workflow.scoring.extrapolation import (
    StressLevels,
    extrapolation_findings,
    near_gauges,
    stress_levels,
)
from tests.support.lifts import SAME, readings_of, write_case, write_readings


def channel(first, second):
    return Channel("a", "a", "convergence", first, second, (1.0, 0.0), 1e-4, "virgin")


class TestNearGauges:
    def test_as_far_from_the_line_as_it_is_long(self):
        places = np.array([[2.0, 0.0], [2.0, 3.9], [2.0, 4.1], [-3.9, 0], [-4.1, 0], [7.9, 0]])
        near = near_gauges(places, (channel((0.0, 0.0), (4.0, 0.0)),))
        assert near.tolist() == [True, True, False, True, False, True]

    def test_a_point_counts_with_the_longest_line(self):
        places = np.array([[20.0, 1.0], [20.0, 3.0], [20.0, 5.0]])
        both = (channel((0.0, 0.0), (4.0, 0.0)), channel(None, (20.0, 0.0)))
        assert near_gauges(places, both).tolist() == [True, True, False]

    def test_without_any_line_all_ground_counts(self):
        assert near_gauges(np.array([[1e3, 0.0]]), (channel(None, (0.0, 0.0)),)).all()


class TestExcess:
    levels = StressLevels(np.array([1.0, 2.0, 1.5, 2.8]), np.array([5.0, 6.0, 6.5, 6.3]))

    def test_is_relative_to_the_largest_before(self):
        deviatoric, compression = self.levels.excess(1)
        assert deviatoric == pytest.approx([np.nan, np.nan, -0.25, 0.4], nan_ok=True)
        assert compression == pytest.approx([np.nan, np.nan, 1 / 12, 0.05], nan_ok=True)

    def test_the_stage_and_the_measure_are_named(self, pit):
        case = load_inputs("case.yaml").case
        case = replace(case, stages=case.stages[:3])
        states = np.array([False, False, True, True])
        (found,) = extrapolation_findings(self.levels, case, 1, states)
        assert (found.kind, found.subject) == ("extrapolation", "lift 3")
        assert found.sentence.startswith(
            "Computed stresses at lift 3 exceed those of the fitted stages by 40 %"
        )
        assert "deviatoric stress" in found.sentence
        assert extrapolation_findings(self.levels, case, 1, states & (np.arange(4) < 3)) == ()

    @pytest.mark.parametrize(("excess", "said"), [(0.09, 0), (0.12, 1)])
    def test_a_tenth_more_stress_is_said(self, pit, excess, said):
        """Rock that yields at 12 % more moved readings by ten accuracies without any word."""
        case = load_inputs("case.yaml").case
        case = replace(case, stages=case.stages[:3])
        level = np.array([1.0, 2.0, 2.0, 2.0 * (1.0 + excess)])
        states = np.array([False, False, True, True])
        found = extrapolation_findings(StressLevels(level, level), case, 1, states)
        assert len(found) == said

    def test_nothing_is_said_without_levels(self, pit):
        case = load_inputs("case.yaml").case
        assert extrapolation_findings(None, case, 1, np.ones(5, dtype=bool)) == ()


@pytest.fixture
def pit(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    write_readings(tmp_path, readings_of(write_case(tmp_path), SAME, seed=1))
    return tmp_path


def levels_of(*overrides):
    model = build_model(load_inputs("case.yaml", overrides=overrides))
    p = np.array([parameter.start for parameter in model.case.parameters])
    fields = model.survey(p, fields=True).fields
    return stress_levels(model, model.case, fields), fields, model


def test_levels_before_construction_are_those_of_the_in_situ_stress(pit):
    """sigma_v = 1 MPa, sigma_h = K0 sigma_v in both horizontal directions: q = |1 - K0| MPa."""
    levels, _, _ = levels_of("parameters.K0.start=1.5")
    assert levels.deviatoric[0] == pytest.approx(0.5e6, rel=1e-9)
    assert levels.compression[0] == pytest.approx(1.5e6, rel=1e-9)


def test_levels_stay_below_the_largest_stress_and_above_the_mean(pit):
    levels, fields, _ = levels_of("parameters.K0.start=1.5")
    stress = fields.stress[4][fields.present[4]]
    largest = -stress[:, :3].min(axis=1)
    assert largest.mean() < levels.compression[4] < -np.linalg.eigvalsh(_tensors(stress)).min()


def _tensors(stress):
    xx, yy, zz, xy, yz, xz = stress.T
    return np.stack([np.stack(r, -1) for r in ((xx, xy, xz), (xy, yy, yz), (xz, yz, zz))], -2)


@pytest.mark.parametrize("law", ["mohr-coulomb", "hardening-soil, E50: 500 MPa, m: 0.5"])
def test_ground_that_may_yield_is_no_elastic_ground(pit, law):
    _, fields, _ = levels_of()
    strong = f"materials.rock.yield={{type: {law}, cohesion: 50 MPa, friction: 30 deg}}"
    model = build_model(load_inputs("case.yaml", overrides=[strong]))
    assert stress_levels(model, model.case, fields) is None


def test_what_is_installed_has_not_been_tested(pit):
    """A stiff fill carries stress that the ground has not borne."""
    plain, _, _ = levels_of()
    fill = "stages[3]={name: lift 4, install: {lift-1: stiff}}"
    stiff = "materials.stiff={elastic: isotropic, E: 500 GPa, nu: 0.25}"
    filled, _, _ = levels_of(stiff, fill)
    assert filled.compression[3] == pytest.approx(plain.compression[3], rel=1e-2)


def test_a_fit_of_the_first_lift_says_that_deeper_ones_are_not_tested(pit):
    said = _findings("fit.stages=[lift 1]")
    assert len(said) == 1
    assert "lift 3" in said[0] or "lift 4" in said[0]
    assert "an elastic model has not been tested there" in said[0]
    assert _findings("fit.stages=[lift 1, lift 2, lift 3]") == []


def _findings(*overrides):
    job = plan_fit(Request("case.yaml", overrides, force=True))
    return [
        t
        for t in sentences_of(fit(job, Control()).result.findings)
        if t.startswith("Computed stresses")
    ]
