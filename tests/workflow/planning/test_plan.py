"""Which gauges to take: closed forms, all sets of few gauges, and fits of readings that were drawn."""

from itertools import combinations

import numpy as np
import pytest

import geoident
from geoident.errors import InputError, UsageError

CASE = """\
format: geoident-case/1
title: Round gallery
analysis: plane-strain
parameters: PARAMETERS
materials:
  rock: {elastic: isotropic, E: MODULUS, nu: 0.25}
groups: {rock: rock, tunnel: rock}
in_situ: {model: heim, vertical: 5 MPa, K0: $K0}
stages:
  - {name: half, excavate: [tunnel], release: {tunnel: 50 %}}
  - {name: full, release: {tunnel: 100 %}}
gauges:
  CV: {kind: convergence, between: [[-2.5 m, 0 m], [2.5 m, 0 m]], accuracy: 0.3 mm}
fit: {method: closed-form, predict_gauges: [CV], model_error: none,
  closed-form: {centre: [0, 0 m], radius: 2.5 m, starts: 1}}
"""
ONE = "{K0: {start: 1.2, bounds: [0, 5], prior: {mean: 1.2, sd: 0.2}}}"
TWO = """
  E: {start: 5 GPa, bounds: [1 GPa, 20 GPa], scale: log, prior: {mean: 5 GPa, sd: 0.5 GPa}}
  K0: {start: 1.2, bounds: [0, 5], prior: {mean: 1.2, sd: 0.2}}"""
A, E, NU, SV, SD = 2.5, 5e9, 0.25, 5e6, 3e-4


def write(folder, angles, parameters=ONE, modulus="5 GPa", more=""):
    """The gallery, and a diameter at each angle to the horizontal among the candidates."""
    case = CASE.replace("PARAMETERS", parameters).replace("MODULUS", modulus)
    (folder / "case.yaml").write_text(case)
    lines = ["gauges:"]
    for angle in angles:
        x, y = A * np.cos(np.deg2rad(angle)), A * np.sin(np.deg2rad(angle))
        lines.append(f"  D{angle}: {{kind: convergence, between: [[{-x} m, {-y} m], [{x} m, {y} m]], "
                     f"accuracy: 0.3 mm{more}}}")  # fmt: skip
    (folder / "gauges.yaml").write_text("\n".join([*lines, ""]))


def by_K0(angle):
    """Derivative of a diameter by K0 once all is released (Kirsch), m."""
    inwards = A * (1.0 + NU) / E * SV * 0.5 * (1.0 + (3.0 - 4.0 * NU) * np.cos(2.0 * np.deg2rad(angle)))
    return 2.0 * inwards


@pytest.fixture
def site(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


def planned(budget, wanted, **more):
    return geoident.plan(
        "case.yaml", candidates="gauges.yaml", budget=budget, wanted=wanted, force=True, **more
    )


def test_the_horizontal_diameter_tells_K0_best_and_that_at_60_degrees_nothing(site):
    write(site, [90, 60, 45, 0, 30])
    plan = planned(1, "K0")
    assert plan.chosen == ("D0",)
    rows = {row.gauge: row for row in plan.data.plan.gauges}
    for angle in (0, 30, 45, 60, 90):  # two readings, of half and of all of the motion
        told = (0.25 + 1.0) * by_K0(angle) ** 2 / SD**2
        part = 1.0 - 1.0 / (1.0 + 0.2**2 * told)
        assert rows[f"D{angle}"].alone == pytest.approx(part, rel=1e-6, abs=1e-9)
    (target,) = plan.targets
    assert target.sd == pytest.approx(0.2)
    assert target.sd_plan == pytest.approx((0.2**-2 + 1.25 * by_K0(0) ** 2 / SD**2) ** -0.5)
    assert target.by_stage[0] == pytest.approx((0.2**-2 + 0.25 * by_K0(0) ** 2 / SD**2) ** -0.5)
    assert target.least_ratio == pytest.approx(target.largest_ratio)  # linear in K0


def test_what_each_adds_and_what_a_loss_costs(site):
    write(site, [0, 90, 45])
    plan = planned(2, "K0")
    assert plan.chosen == ("D0", "D45")[: len(plan.chosen)] or plan.chosen[0] == "D0"
    first, second = plan.data.plan.chosen

    def left(*angles):
        return 1.0 / (1.0 + 0.2**2 * sum(1.25 * by_K0(a) ** 2 for a in angles) / SD**2)

    other = int(second.gauge[1:])
    assert first.adds == pytest.approx(1.0 - left(0))
    assert second.adds == pytest.approx(left(0) - left(0, other))
    assert first.loss == pytest.approx(np.sqrt(left(other) / left(0, other)) - 1.0)
    assert first.stages.split(", ")[0] == "full"


def test_of_all_pairs_it_takes_the_one_that_leaves_least(site):
    angles = [0, 5, 45, 90, 70]
    write(site, angles, TWO, "$E")
    best = planned(2, ["CV at full", "K0"], draws=0)
    sizes = {}
    for pair in combinations(angles, 2):
        write(site, pair, TWO, "$E")
        targets = planned(2, ["CV at full", "K0"], draws=0).targets
        sizes[pair] = np.mean([(one.sd_plan / one.sd_case) ** 2 for one in targets])
    least = min(sizes, key=sizes.get)
    assert {f"D{angle}" for angle in least} == set(best.chosen)


def test_costs_are_kept_and_what_is_read_when(site):
    write(site, [0, 90], TWO, "$E", more=", cost: 2.5, stages: half")
    plan = planned(4, "E")
    assert len(plan.chosen) == 1
    assert plan.data.plan.cost == 2.5
    assert plan.data.plan.chosen[0].stages == "half"


def test_fits_of_readings_that_were_drawn_know_the_target_as_well_as_stated(site):
    write(site, [0, 45, 90], TWO, "$E", more=", stages: half")
    plan = planned(2, "CV at full", draws=0)
    stated = plan.targets[0].sd_plan
    chosen = {
        name: line.strip().partition(": ")[2].replace(", stages: half", "")
        for line in (site / "gauges.yaml").read_text().splitlines()[1:]
        if (name := line.strip().partition(":")[0]) in plan.chosen
    }
    assert len(chosen) == 2
    text = (site / "case.yaml").read_text()
    gauges = "".join(f"  {name}: {gauge}\n" for name, gauge in chosen.items())
    text = text.replace("fit: {", f"{gauges}readings: readings.csv\nfit: {{stages: [half], ")
    (site / "case.yaml").write_text(text)
    rng = np.random.default_rng(5)
    errors, said = [], []
    for seed in range(25):
        p = {"E": 5e9 * np.exp(0.1 * rng.standard_normal()), "K0": 1.2 + 0.2 * rng.standard_normal()}
        case = geoident.load_case("case.yaml", overrides={"readings": []})
        truth = case.with_values({f"parameters.{name}.start": f"{x}{' Pa' * (name == 'E')}"
                                  for name, x in p.items()})  # fmt: skip
        exact = {(r.channel, r.stage): r.value for r in geoident.simulate(truth).readings}
        read = [f"{name},half,{1e3 * exact[name, 'half'] + 0.3 * rng.standard_normal()},mm"
                for name in chosen]  # fmt: skip
        (site / "readings.csv").write_text("\n".join(["gauge,stage,value,unit", *read, ""]))
        fit = geoident.fit("case.yaml", force=True)
        row, stage = fit.data.gauges.channels.index("CV"), 1
        errors.append(exact["CV", "full"] - fit.data.prediction.mean[row, stage])
        said.append(fit.data.prediction.sd[row, stage])
    # the band is that of a reading: with its accuracy, of which the truth has none
    assert np.median(said) == pytest.approx(stated, rel=0.05)
    assert np.sqrt(np.mean(np.square(errors))) == pytest.approx(
        np.sqrt(stated**2 - SD**2), rel=0.35
    )
    from_fit = geoident.plan(fit, candidates=written(site), budget=1, wanted="CV at full", draws=2)
    assert from_fit.targets[0].sd == pytest.approx(said[-1], rel=1e-6)
    assert from_fit.targets[0].expected == pytest.approx(fit.data.prediction.mean[row, stage])


def written(folder):
    """A candidate that begins where a fit has ended."""
    (folder / "later.yaml").write_text(
        "gauges: {T: {kind: stress, point: [4 m, 0 m], components: [yy], accuracy: 0.1 MPa}}\n"
    )
    return "later.yaml"


def test_of_a_limit_the_chance_is_told_and_whether_readings_will_settle_it(site):
    write(site, [0, 90], TWO, "$E", more=", stages: half")
    plan = planned(1, "CV < -9 mm at full")
    (target,) = plan.targets
    z = (-9e-3 - target.expected) / target.sd
    from scipy.stats import norm  # noqa: PLC0415 - beside the test

    assert target.probability == pytest.approx(norm.cdf(z))
    moves = np.sqrt(target.sd**2 - target.sd_plan**2)
    means = target.expected + moves * np.random.default_rng(1).standard_normal(200_000)
    chance = norm.cdf((-9e-3 - means) / target.sd_plan)
    settled = np.mean((chance < 0.05) | (chance > 0.95))
    assert target.settled_plan == pytest.approx(settled, abs=0.005)
    assert target.settled_case < target.settled_plan


@pytest.mark.parametrize(
    ("wanted", "budget", "words"),
    [
        ("CW at full", 1, "there is no channel 'CW'"),
        ("CV at fall", 1, "Did you mean 'full'"),
        ("K1", 1, "Parameters: K0"),
        ("CV > 3 kPa at full", 1, "is a pressure"),
        ("K0", 0.5, "the cheapest candidate costs 1"),
    ],
)
def test_what_cannot_be_planned_is_refused(wanted, budget, words, site):
    write(site, [0])
    with pytest.raises(UsageError, match=words):
        planned(budget, wanted)


def test_what_is_past_can_neither_be_predicted_nor_be_installed(site):
    write(site, [0])
    text = (site / "case.yaml").read_text().replace("predict_gauges: [CV], ", "")
    text = text.replace("fit: {", "readings: [{gauge: CV, stage: half, value: -4.1 mm}]\nfit: {")
    (site / "case.yaml").write_text(text)
    fit = geoident.fit("case.yaml")
    with pytest.raises(UsageError, match="'half' is past"):
        geoident.plan(fit, candidates="gauges.yaml", budget=1, wanted="CV at half")
    with pytest.raises(InputError, match=r"gauges.yaml:2:3.*'virgin', which is past") as refused:
        geoident.plan(fit, candidates="gauges.yaml", budget=1, wanted="K0")
    assert "zero: half" in refused.value.faults[0].hint
