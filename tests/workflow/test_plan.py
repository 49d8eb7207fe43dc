"""Which gauges to take: closed forms, all sets of few gauges, fits of readings that were drawn."""

from itertools import combinations

import numpy as np
import pytest
from scipy.stats import norm

import geoident
from geoident.errors import InputError, UsageError
from tests.support.trench import CASE as TRENCH
from tests.support.trench import write_case

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


def write(folder, angles, parameters=ONE, modulus="5 GPa", extra=""):
    """The gallery, and a diameter at each angle to the horizontal among the candidates."""
    case = CASE.replace("PARAMETERS", parameters).replace("MODULUS", modulus)
    (folder / "case.yaml").write_text(case)
    lines = ["gauges:"]
    for angle in angles:
        x, y = A * np.cos(np.deg2rad(angle)), A * np.sin(np.deg2rad(angle))
        points = f"[[{-x} m, {-y} m], [{x} m, {y} m]]"
        more = f"accuracy: 0.3 mm{extra}"
        lines.append(f"  D{angle}: {{kind: convergence, between: {points}, {more}}}")
    (folder / "gauges.yaml").write_text("\n".join([*lines, ""]))


def by_ratio(angle):
    """Derivative of a diameter by K0 once all is released (Kirsch), m."""
    inwards = (
        A * (1.0 + NU) / E * SV * 0.5 * (1.0 + (3.0 - 4.0 * NU) * np.cos(2.0 * np.deg2rad(angle)))
    )
    return 2.0 * inwards


@pytest.fixture
def site(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


def planned(budget, wanted, **more):
    return geoident.plan(
        "case.yaml", candidates="gauges.yaml", budget=budget, wanted=wanted, force=True, **more
    )


def test_the_horizontal_diameter_tells_most_and_that_at_60_degrees_nothing(site, verification):
    write(site, [90, 60, 45, 0, 30])
    plan = planned(1, "K0")
    assert plan.chosen == ("D0",)
    assert [row.rank for row in plan.data.plan.gauges] == [1, 0, 0, 0, 0]
    rows = {row.gauge: row for row in plan.data.plan.gauges}
    angles = (0, 30, 45, 60, 90)  # two readings of each, of half and of all of the motion
    told = np.array([(0.25 + 1.0) * by_ratio(angle) ** 2 / SD**2 for angle in angles])
    exact, found = 1.0 - 1.0 / (1.0 + 0.2**2 * told), [rows[f"D{a}"].alone for a in angles]
    assert found == pytest.approx(exact, rel=1e-6, abs=1e-9)
    verification("plan-diameters", "", angles, exact=exact, found=found)
    (target,) = plan.targets
    assert target.sd == pytest.approx(0.2)
    assert target.sd_plan == pytest.approx((0.2**-2 + 1.25 * by_ratio(0) ** 2 / SD**2) ** -0.5)
    assert target.least_ratio == pytest.approx(target.largest_ratio)  # linear in K0


def test_what_each_adds_and_what_a_loss_costs(site):
    write(site, [0, 90, 45])
    plan = planned(2, "K0")
    assert plan.chosen[0] == "D0"
    first, second = plan.data.plan.chosen

    def left(*angles):
        return 1.0 / (1.0 + 0.2**2 * sum(1.25 * by_ratio(a) ** 2 for a in angles) / SD**2)

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
    assert [row.rank for row in best.data.plan.gauges] == [1, 2, 0, 0, 0]


def test_costs_are_kept_and_what_is_read_when(site):
    write(site, [0, 90], TWO, "$E", extra=", cost: 2.5, stages: half")
    plan = planned(4, "E")
    assert len(plan.chosen) == 1
    assert plan.data.plan.cost == 2.5
    assert plan.data.plan.chosen[0].stages == "half"


def test_a_reading_of_the_stage_that_is_predicted_or_later_comes_too_late(site):
    write(site, [0, 90], TWO, "$E")
    every = planned(2, ["CV at full", "K0"], draws=0).targets
    write(site, [0, 90], TWO, "$E", extra=", stages: half")
    before = planned(2, ["CV at full", "K0"], draws=0).targets
    assert every[0].sd_plan == pytest.approx(before[0].sd_plan)
    assert every[1].sd_plan < 0.95 * before[1].sd_plan


def test_gauges_of_the_case_count_as_read_unless_they_are_only_predicted(site):
    write(site, [90], TWO, "$E")
    alone = planned(1, "CV at full", draws=0).targets[0]
    assert alone.sd_case == alone.sd
    text = (site / "case.yaml").read_text().replace("predict_gauges: [CV], ", "")
    (site / "case.yaml").write_text(text)
    read = planned(1, "CV at full", draws=0)
    assert read.targets[0].sd == alone.sd
    assert read.targets[0].sd_case < 0.5 * alone.sd
    assert "CV of the case" in " ".join(read.data.notes)


def test_model_error_and_shared_errors_count_as_in_a_fit(site):
    write(site, [0, 45, 90], TWO, "$E")
    for name in ("case.yaml", "gauges.yaml"):
        text = (site / name).read_text().replace("model_error: none", "model_error: 15 %")
        shared = "accuracy: {reading: 0.2 mm, zero: 0.4 mm}"
        (site / name).write_text(text.replace("accuracy: 0.3 mm", shared))
    plan = planned(2, "CV at full", draws=0)
    stated = plan.targets[0].sd_plan
    text = plan.data.case_resolved.replace(
        "fit:\n", "readings: readings.csv\nfit:\n  stages: [half]\n"
    )
    (site / "taken.yaml").write_text(text)
    read = {r.channel: r.value for r in geoident.simulate(with_gauges(site, plan)).readings
            if r.stage == "half"}  # fmt: skip
    rows = [f"{name},half,{1e3 * read[name]!r},mm" for name in plan.chosen]
    (site / "readings.csv").write_text("\n".join(["gauge,stage,value,unit", *rows, ""]))
    fit = geoident.fit("taken.yaml")
    row = fit.data.gauges.channels.index("CV")
    assert fit.data.prediction.sd[row, 1] == pytest.approx(stated, rel=0.02)
    (site / "case.yaml").write_text((site / "case.yaml").read_text().replace("15 %", "none"))
    assert planned(2, "CV at full", draws=0).targets[0].sd_plan < 0.95 * stated


def with_gauges(folder, plan):
    """A case with the gauges that were chosen, without readings."""
    (folder / "chosen.yaml").write_text(plan.data.case_resolved)
    return "chosen.yaml"


def test_a_table_of_runs_tells_of_candidates_that_have_columns(site):
    rng = np.random.default_rng(2)
    rows = []
    for k, (a, b) in enumerate(rng.uniform(-3.0, 3.0, (40, 2))):
        values = [a, b, a + 0.5 * b, a - b, 2.0 * b, 0.4 * a + 0.1 * b]
        rows.append(",".join([str(k + 1), *(f"{x:.10g}" for x in values)]))
    head = "run,a,b,P @ late [m],C1 @ early [m],C2 @ early [m],C3 @ early [m]"
    (site / "runs.csv").write_text("\n".join([head, *rows, ""]))
    columns = ", ".join(f'"C{k} @ early [m]"' for k in (1, 2, 3))
    (site / "case.yaml").write_text(
        "format: geoident-case/1\n"
        f"model: {{kind: table, file: runs.csv, ignore: [{columns}]}}\n"
        "parameters:\n"
        "  a: {start: 0.0, bounds: [-3, 3], prior: {mean: 0, sd: 0.5}}\n"
        "  b: {start: 0.0, bounds: [-3, 3], prior: {mean: 0, sd: 0.4}}\n"
        "stages: [{name: early}, {name: late}]\n"
        "gauges: {P: {kind: reading, accuracy: 20 mm}}\n"
        "fit: {model_error: none}\n"
    )
    (site / "gauges.yaml").write_text("gauges:\n" + "".join(
        f"  C{k}: {{kind: reading, accuracy: 100 mm}}\n" for k in (1, 2, 3)))  # fmt: skip
    plan = planned(2, "P at late", draws=1)
    prior, of_target = np.diag([0.25, 0.16]), np.array([1.0, 0.5])
    rows_of = {"C1": [1.0, -1.0], "C2": [0.0, 2.0], "C3": [0.4, 0.1]}
    sd = {}
    for pair in combinations(rows_of, 2):
        J = np.array([rows_of[name] for name in pair])
        C = np.linalg.inv(np.linalg.inv(prior) + J.T @ J / 0.1**2)
        sd[pair] = np.sqrt(of_target @ C @ of_target + 0.02**2)
    best = min(sd, key=sd.get)
    assert set(plan.chosen) == set(best)
    assert plan.targets[0].sd_plan == pytest.approx(sd[best], rel=0.01)
    with (site / "gauges.yaml").open("a") as file:
        file.write("  C9: {kind: reading, accuracy: 100 mm}\n")
    with pytest.raises(InputError, match=r"gauges.yaml:5:3: gauges.C9: 'C9' has no column"):
        planned(2, "P at late")


@pytest.mark.slow
def test_fits_of_readings_that_were_drawn_know_the_target_as_well_as_stated(site):
    write(site, [0, 45, 90], TWO, "$E", extra=", stages: half")
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
    for _ in range(25):
        p = {
            "E": 5e9 * np.exp(0.1 * rng.standard_normal()),
            "K0": 1.2 + 0.2 * rng.standard_normal(),
        }
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
    write(site, [0, 90], TWO, "$E", extra=", stages: half")
    plan = planned(1, "CV < -9 mm at full")
    (target,) = plan.targets
    late = planned(1, "CV at half")
    assert (late.chosen, late.targets[0].sd_plan) == ((), late.targets[0].sd)
    assert "Nothing can be read before it is due: CV at half." in late.data.notes
    z = (-9e-3 - target.expected) / target.sd
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
        ("K0", 0, "The budget of 0 buys nothing"),
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


@pytest.mark.usefixtures("plain_pictures")
def test_all_candidates_of_a_mesh_come_from_one_evaluation_and_the_page_shows_the_chosen(site):
    write_case(site)
    text = TRENCH.replace("readings: readings.csv\n", "").replace("stages: [first], ", "")
    (site / "case.yaml").write_text(text.replace("  S:  {", "  P:  {"))
    lines = [
        f"  T{k}: {{kind: convergence, between: [[2 m, {y} m], [4 m, {y} m]], accuracy: 0.01 mm}}"
        for k, y in enumerate((2.5, 3.0, 3.2))
    ] + [f"  U{k}: {{kind: settlement, point: [{x} m, 4 m], accuracy: 0.01 mm}}"
         for k, x in enumerate((0.5, 1.5, 5.5))]  # fmt: skip
    (site / "gauges.yaml").write_text("\n".join(["gauges:", *lines, ""]))
    plan = planned(2, "CV at second", draws=0)
    assert plan.data.counts.evaluations == 1
    assert len(plan.chosen) == 2
    geoident.report(plan)
    text = (site / "case.plan.html").read_text(encoding="utf-8")
    for words in (
        "Gauges to take",
        "Orange: the gauges to take",
        "CV at second",
    ):
        assert words in text, words
    for name in plan.chosen:
        assert name in plan.data.case_resolved
    again = geoident.plan("case.yaml", candidates="gauges.yaml", budget=2, wanted="CV at second",
                          draws=0)  # fmt: skip
    assert again.up_to_date
    read = geoident.read_result(plan.path)
    assert read.chosen == plan.chosen
    assert read.targets[0].sd_plan == plan.targets[0].sd_plan
