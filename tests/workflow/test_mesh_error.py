"""The error of the mesh: against closed forms, in words, and in what a fit says."""

import json
import shutil
from dataclasses import replace

import numpy as np
import pytest
from click.testing import CliRunner

from geoident.cli.app import geoident
from geoident.fem.faces import face_table
from geoident.fem.refinement.singularity import exponent, openings
from geoident.model.actions import Pressure
from geoident.model.case import Analysis, Stage, Support
from geoident.model.in_situ import ConstantStress
from geoident.model.parameter import Scalar
from geoident.model.results.costs import NO_COST
from geoident.model.results.findings import sentences_of
from geoident.workflow.estimating import fitted_mesh as in_fits
from geoident.workflow.estimating import mesh_error as module
from geoident.workflow.estimating.mesh_error import mesh_error, mesh_sentence
from geoident.workflow.estimating.recovery import EnergyError
from geoident.workflow.estimating.search import estimated
from geoident.workflow.estimating.setup import Setup, prepare
from geoident.workflow.fit import fit as run_fit
from geoident.workflow.predict import PredictRequest, plan_prediction
from geoident.workflow.predict import predict as run_predict
from geoident.workflow.running.control import Control
from geoident.workflow.running.jobs import Request, plan_fit
from geoident.workflow.simulate import simulate
from tests.support.cases import displacement, material, model, rollers
from tests.support.closed_forms import kirsch, lame_cylinder
from tests.support.deck import write_deck
from tests.support.meshes import KINDS_2D, box, opening
from tests.support.revolved import section

RADIUS, E, NU = 2.0, 10e9, 0.22
ROCK = {"rock": material("rock", E, NU)}
NOTHING = np.empty(0)


def excavated(kind, n, *, reach=40.0):
    """A quarter of a round hole, its wall read along both axes, and the exact readings."""
    mesh = opening(kind, 2, n=n, layers=3 * n, radius=RADIUS, reach=reach * RADIUS)
    wall = np.unique(mesh.blocks[0].nodes)
    wall = wall[np.abs(np.linalg.norm(mesh.points[wall], axis=1) - RADIUS) < 1e-9]
    read = [(k, a) for k in wall for a in (0, 1) if abs(mesh.points[k, a]) > 1e-9]
    zero = Scalar(0.0)
    staged = model(
        mesh,
        materials=ROCK,
        groups={"core": "rock", "rock": "rock"},
        supports=rollers(2),
        in_situ=ConstantStress((Scalar(-13e6), Scalar(-8e6), Scalar(-9e6), zero, zero, zero)),
        stages=(Stage("open", excavate=("core",)),),
        channels=tuple(
            displacement(f"c{k}.{a}", tuple(mesh.points[k]), tuple(np.eye(2)[a])) for k, a in read
        ),
    )
    places = mesh.points[[k for k, _ in read]]
    exact = kirsch(places, radius=RADIUS, E=E, nu=NU, horizontal=13e6, vertical=8e6)
    return staged, exact[np.arange(len(read)), [a for _, a in read]]


def pressed(kind, n):
    """A thick cylinder about its axis, and what its inner face moves."""
    mesh = section(kind, (n, 1), (2.0, 0.5), inner=1.0)
    staged = model(
        mesh,
        analysis=Analysis.AXISYMMETRIC,
        materials=ROCK,
        groups={"all": "rock"},
        supports=(Support("y0", (1,)), Support("y1", (1,))),
        stages=(Stage("press", loads={"p": Pressure("x0", Scalar(1e6))}),),
        channels=(displacement("wall", (1.0, 0.0), (1.0, 0.0)),),
    )
    exact = lame_cylinder(np.ones(1), inner=1, outer=3, pressure=1e6, E=E, nu=NU)
    return staged, exact


def effectivity(staged, exact):
    found = mesh_error(staged, staged.case, NOTHING)
    assert found.how == "refinement"
    true = exact - found.computed[:, 0]
    return np.linalg.norm(found.error[:, 0]) / np.linalg.norm(true)


@pytest.mark.parametrize(
    ("kind", "n"), [("tri3", 2), ("tri3", 4), ("tri3", 8), ("quad4", 2), ("quad4", 4),
                    ("quad4", 8), ("tri6", 2), ("quad8", 2)],
)  # fmt: skip
def test_the_error_of_a_hole_is_that_against_kirsch(kind, n):
    assert 0.7 < effectivity(*excavated(kind, n)) < 1.4


@pytest.mark.parametrize("kind", KINDS_2D)
@pytest.mark.parametrize("n", [2, 4])
def test_the_error_of_a_cylinder_is_that_against_lame(kind, n):
    assert 0.5 < effectivity(*pressed(kind, n)) < 2.0


def test_corners_are_seen_with_their_openings():
    """A square hole has four corners of 270 degrees; a round one of curved elements has none."""
    mesh = box("quad4", (6, 6))
    centre = mesh.points[mesh.blocks[0].nodes].mean(axis=1)
    present = np.any(np.abs(centre - 0.5) > 1.0 / 6.0, axis=1)
    table = face_table(mesh)
    found = np.degrees(openings(mesh, table, present))
    assert np.count_nonzero(np.abs(found - 270.0) < 1e-6) == 4
    assert np.count_nonzero(np.abs(found - 90.0) < 1e-6) == 4
    assert exponent(1.5 * np.pi) == pytest.approx(0.544484, abs=1e-6)
    for kind, sharpest in (("quad8", 180.5), ("quad4", 191.5)):
        staged, _ = excavated(kind, 4)
        assert np.degrees(module.orders(staged)[1]) <= sharpest
    cube = box("hex8", (3, 3, 3))
    middle = cube.points[cube.blocks[0].nodes].mean(axis=1)
    hollow = np.any(np.abs(middle - 0.5) > 0.2, axis=1)
    edges = np.degrees(openings(cube, face_table(cube), hollow))
    assert np.count_nonzero(np.abs(edges - 270.0) < 1e-6) == 12


def test_a_square_hole_converges_slowly_and_that_is_said():
    """Against a mesh that is refined twice more; the order of the corner is 1.09."""
    mesh = box("quad4", (8, 8))
    centre = mesh.points[mesh.blocks[0].nodes].mean(axis=1)
    hole = np.all(np.abs(centre - 0.5) < 0.25, axis=1)
    mesh = replace(mesh, groups={"hole": np.flatnonzero(hole), "rock": np.flatnonzero(~hole)})

    def at(mesh):
        return model(
            mesh, materials=ROCK, groups={"hole": "rock", "rock": "rock"}, supports=rollers(2),
            in_situ=ConstantStress((Scalar(-1e6), Scalar(-1e6), *[Scalar(0.0)] * 4)),
            stages=(Stage("dig", excavate=("hole",)),),
            channels=(displacement("side", (0.75, 0.5), (1.0, 0.0)),),
        )  # fmt: skip

    staged = at(mesh)
    found = mesh_error(staged, staged.case, NOTHING)
    assert found.order == pytest.approx(1.089, abs=1e-3)
    assert any("Corners of 270 degrees" in note for note in found.notes)
    fine = mesh
    for _ in range(4):
        fine = module.halved(fine)
    true = at(fine).computed(NOTHING) - found.computed
    assert 0.7 < float(found.error[0, 0] / true[0, 0]) < 1.5


@pytest.mark.parametrize(("kind", "n"), [("tri3", 4), ("tri3", 8), ("quad4", 4), ("quad4", 8)])
def test_jumps_of_the_stress_tell_about_the_same(kind, n, monkeypatch):
    staged, exact = excavated(kind, n)
    monkeypatch.setattr(module, "free_memory", lambda: 1e6)
    found = mesh_error(staged, staged.case, NOTHING)
    assert found.how == "recovery"
    assert found.notes[0].startswith("One refinement needs about 0.1 GB of memory")
    true = np.linalg.norm(exact - found.computed[:, 0])
    assert 0.4 < np.linalg.norm(found.error) / true < 2.5
    jumps = EnergyError(staged, NOTHING)
    staged.computed(NOTHING, jumps.add)
    assert jumps.relative < 0.1


def test_what_takes_too_long_is_not_refined_beside_a_fit(monkeypatch):
    staged, _ = excavated("tri3", 2)
    plain = module.estimate_cost(staged, solver="splu")
    slow = replace(module.refinement_cost(staged, plain), seconds=1e4)
    monkeypatch.setattr(module, "refinement_cost", lambda _model, _cost: slow)
    assert mesh_error(staged, staged.case, NOTHING, patience=60).how == "recovery"
    assert mesh_error(staged, staged.case, NOTHING).how == "refinement"


def cube(n):
    """A cubic hole in a cube of hexahedra, and readings of its side."""
    mesh = box("hex8", (n,) * 3)
    centre = mesh.points[mesh.blocks[0].nodes].mean(axis=1)
    hole = np.all(np.abs(centre - 0.5) < 0.25, axis=1)
    mesh = replace(mesh, groups={"hole": np.flatnonzero(hole), "rock": np.flatnonzero(~hole)})
    places = ((0.75, 0.5, 0.5), (0.75, 0.7, 0.5), (0.9, 0.5, 0.5))
    return model(
        mesh, materials=ROCK, groups={"hole": "rock", "rock": "rock"}, supports=rollers(3),
        in_situ=ConstantStress((*[Scalar(-1e6)] * 3, *[Scalar(0.0)] * 3)),
        stages=(Stage("dig", excavate=("hole",)),),
        channels=tuple(displacement(f"c{k}", at, (1.0, 0.0, 0.0)) for k, at in enumerate(places)),
    )  # fmt: skip


def test_where_halving_is_too_large_in_space_second_order_may_not_be(monkeypatch):
    """Half the operations; against a mesh of a quarter of the size."""
    staged = cube(4)
    plain = module.estimate_cost(staged, solver=staged.solver_name, rough=True)
    fine, second = module.refinement_cost(staged, plain), module.order_step_cost(staged, plain)
    assert second.seconds < 0.5 * fine.seconds
    assert second.memory < fine.memory
    between = 0.5 * (second.memory + fine.memory) / module.SHARE_OF_MEMORY
    whole = mesh_error(staged, staged.case, NOTHING)
    monkeypatch.setattr(module, "free_memory", lambda: between)
    found = mesh_error(staged, staged.case, NOTHING)
    assert (whole.how, found.how) == ("refinement", "order")
    assert found.elements == (64, 64)
    assert "Elements of second order on the same edges were taken instead" in found.notes[0]
    left = 4.0**-found.order
    np.testing.assert_allclose(found.error, found.change / (1.0 - left))
    true = cube(16).computed(NOTHING) - found.computed
    assert 0.4 < np.linalg.norm(found.error) / np.linalg.norm(true) < 1.3
    monkeypatch.setattr(module, "free_memory", lambda: 1e6)
    assert mesh_error(staged, staged.case, NOTHING).how == "recovery"


def test_doubts_of_a_channel_are_parts_of_its_own_error_and_of_that_of_its_kind():
    staged, _ = excavated("tri3", 2)
    found = mesh_error(staged, staged.case, NOTHING)
    mean = np.sqrt(np.mean(found.error**2))
    size = np.hypot(0.2 * found.error, 0.1 * mean)
    np.testing.assert_allclose(found.doubt, np.copysign(size, found.error))
    jumps = replace(found, how="recovery")
    size = np.hypot(0.5 * found.error, 0.1 * mean)
    np.testing.assert_allclose(jumps.doubt, np.copysign(size, found.error))
    other = ("angle", *found.dimensions[1:])
    alone = replace(found, dimensions=other).doubt
    assert alone[0, 0] == pytest.approx(np.hypot(0.2, 0.1) * found.error[0, 0])
    unknown = found.error.copy()
    unknown[0] = np.nan
    assert replace(found, error=unknown).doubt[0, 0] == 0.0


def test_a_channel_that_errs_to_both_sides_is_uncertain_to_both():
    """What is too much of its pattern in one stage is too much of it in the other."""
    staged, _ = excavated("tri3", 2)
    found = mesh_error(staged, staged.case, NOTHING)
    turned = replace(found, error=np.hstack([found.error, -found.error]))
    np.testing.assert_allclose(turned.doubt[:, -1], -turned.doubt[:, 0])
    names = (*found.stages, "back")
    case = in_fits.with_mesh_error(
        staged.case, replace(turned, stages=names, computed=np.tile(found.computed, 2))
    )
    parts = case.channels[0].errors
    assert parts is not None
    (_, error, doubt), (_, back, doubt_back) = parts.mesh
    assert error * doubt > 0.0
    assert (back, doubt_back) == (-error, -doubt)


def test_second_order_is_advised_to_those_who_have_not_got_it():
    for kind, advised in (("tri3", True), ("quad4", True), ("tri6", False), ("quad8", False)):
        staged, _ = excavated(kind, 2)
        found = mesh_error(staged, staged.case, NOTHING)
        fussy = replace(found, accuracy=np.full(found.error.shape, 1e-9))
        said = mesh_sentence(fussy, np.ones(found.error.shape, dtype=bool))
        assert "Halve the elements where the ground moves most" in said
        assert ("second order" in said) is advised


def test_a_sentence_says_whether_it_matters():
    staged, _ = excavated("tri3", 4)
    found = mesh_error(staged, staged.case, NOTHING)
    everything = np.ones(found.error.shape, dtype=bool)
    for accuracy, said in (
        (1e-6, "The mesh is too coarse for these readings: {mean} ({most}). Halve the elements "
         "where the ground moves most, or write 'order: 2' under 'mesh' for elements of second "
         "order."),
        (4e-4, "The mesh is fine enough: {mean} ({most})."),
        (1.0, "Little of the accuracy of the readings is lost to mesh error ({most})."),
    ):  # fmt: skip
        one = replace(found, accuracy=np.full(found.error.shape, accuracy))
        i, j = np.unravel_index(one.share.argmax(), one.share.shape)
        size, part = 1e3 * abs(one.error[i, j]), one.share[i, j]
        most = f"at most {size:.2g} mm at {one.channels[i]} in {one.stages[j]}, "
        most += f"{part:.2g} accuracies"
        mean = f"the mesh error of the readings is on average {one.scatter(everything):.2g} times "
        mean += "their accuracy"
        assert mesh_sentence(one, everything) == said.format(mean=mean, most=most)


# What a fit says of a coarse mesh


CAVERN = """\
format: geoident-case/1
title: Cavern in a coarse mesh
analysis: plane-strain
mesh: {file: coarse.inp}
parameters:
  E: {start: 5 GPa, bounds: [0.1 GPa, 100 GPa], scale: log}
materials:
  rock: {E: $E, nu: 0.22}
groups: {rock: rock, top: rock, floor: rock}
supports: {x0: x, x1: x, y0: y}
in_situ: {model: heim, vertical: 8 MPa, K0: 1}
stages:
  - {name: heading, excavate: [top]}
  - {name: bench, excavate: [floor]}
gauges:
  CV: {kind: convergence, between: [[20 m, 22 m], [30 m, 22 m]], accuracy: 0.1 mm}
  R:  {kind: extensometer, head: [30 m, 22 m], anchors: {a5: [35 m, 22 m]}, accuracy: 0.1 mm}
  S:  {kind: settlement, point: [25 m, 25 m], accuracy: 0.1 mm}
readings: readings.csv
fit: {method: gauss-newton, stages: [heading]}
"""


def cavern(kind, n):
    """A cavern of 10 m by 10 m in a plate of 50 m by 45 m, dug in two halves; n cells a side."""
    mesh = box(kind, n, size=(50.0, 45.0))
    x, y = mesh.points[mesh.blocks[0].nodes].mean(axis=1).T
    inside = (np.abs(x - 25.0) < 5.0) & (y > 15.0) & (y < 25.0)
    top = inside & (y > 20.0)
    return replace(mesh, groups={
        "top": np.flatnonzero(top), "floor": np.flatnonzero(inside & ~top),
        "rock": np.flatnonzero(~inside),
    })  # fmt: skip


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """The case on 180 triangles; its readings are those of quad8 elements at E = 10 GPa."""
    folder = tmp_path_factory.mktemp("cavern")
    (folder / "case.yaml").write_text(CAVERN)
    write_deck(cavern("quad8", (20, 18)), folder / "fine.inp")
    write_deck(cavern("tri3", (10, 9)), folder / "coarse.inp")
    at = ["mesh.file=fine.inp", "parameters.E.start=10 GPa"]
    found = simulate(str(folder / "case.yaml"), overrides=at)
    rows = [f"{r.channel},{r.stage},{1e3 * r.value!r},mm" for r in found.readings]
    (folder / "readings.csv").write_text("\n".join(["gauge,stage,value,unit", *rows]) + "\n")
    return folder


@pytest.fixture
def coarse(files, tmp_path):
    """The case in a folder of the test."""
    return shutil.copytree(files, tmp_path, dirs_exist_ok=True) / "case.yaml"


def fitted(path, **changes):
    job = plan_fit(Request(str(path), force=True, fresh=True, **changes))
    return run_fit(job, Control()).result


def test_a_fit_says_that_its_mesh_is_too_coarse_and_its_interval_covers(coarse):
    blind = fitted(coarse, overrides=("fit.mesh_error=false",)).parameters
    assert not blind.lower95[0] < 10e9 < blind.upper95[0]
    found = fitted(coarse)
    E = found.parameters
    assert E.lower95[0] < 10e9 < E.upper95[0]
    assert any(
        "The mesh is too coarse for these readings" in said for said in sentences_of(found.findings)
    )
    bands = found.prediction
    truth = found.gauges.measured[:, 1]
    assert np.all((bands.lower95[:, 1] < truth) & (truth < bands.upper95[:, 1]))
    # what a later command makes of the result is the same
    task = plan_prediction(
        PredictRequest(Request(str(coarse.with_name("case.fit.h5")), force=True))
    )
    later = run_predict(task, Control()).result.prediction
    np.testing.assert_allclose(later.sd, bands.sd, rtol=1e-6)
    np.testing.assert_allclose(later.mean, bands.mean, rtol=1e-9)


class NoLog:
    """Keeps nothing."""

    def find(self, kind, p):
        return None

    def add(self, kind, p, arrays):
        pass


def test_a_fit_asks_for_the_stages_that_it_uses_and_for_all_where_the_mesh_counts(
    coarse, monkeypatch
):
    """Whether it counts is the same question in both; drift of a gauge is no error of the mesh."""
    analysed = []

    class Counted(module.ResumableRun):
        def computed(self, last):
            analysed.append(last)
            return super().computed(last)

    monkeypatch.setattr(module, "ResumableRun", Counted)
    text = coarse.read_text().replace(
        "accuracy: 0.1 mm}", "accuracy: 0.1 mm, drift: 1 mm/month}", 1
    )
    dates = "dates: {virgin: 2024-01-01, heading: 2024-01-31, bench: 2024-02-29}\n"
    coarse.write_text(text + dates)
    path = coarse.with_name("readings.csv")
    head, *rows = path.read_text().splitlines()
    dated = [f"{row},2024-01-{20 if 'heading' in row else 31}" for row in rows]
    path.write_text("\n".join([f"{head},date", *dated]) + "\n")
    for accuracy, asked in (("100 mm", [1]), ("0.1 mm", [1, 2])):
        analysed.clear()
        rough = tuple(f"gauges.{name}.accuracy={accuracy}" for name in ("CV", "R", "S"))
        job = plan_fit(Request(str(coarse), rough, force=True, fresh=True))
        found, _, outcome = estimated(prepare(job), job.methods, NoLog(), Control())
        assert analysed == asked
        whole = mesh_error(found.model, found.model.case, outcome.values)
        first = found.readings.used
        rows = [whole.channels.index(name) for name in np.array(found.readings.channel)[first]]
        ours, theirs = (table.error[rows, 0] for table in (found.mesh.table, whole))
        assert ours / theirs == pytest.approx(ours[0] / theirs[0], rel=1e-6)  # all go with 1 / E


def test_what_the_finer_mesh_costs_is_counted(coarse, monkeypatch):
    """A factorization for each stage on the finer mesh; the analysis of the search goes on."""
    override = ("fit.model_error=none",)
    job = plan_fit(Request(str(coarse), override, force=True, fresh=True))
    found, problem, outcome = estimated(prepare(job), job.methods, NoLog(), Control())
    assert found.mesh.table.cost.factorizations == 2
    assert found.mesh.spent.factorizations == 2 + 1
    counted = fitted(coarse, overrides=override).counts
    again = in_fits.fitted_mesh(found.model, problem, found.readings, outcome, found.mesh)
    assert again.spent.factorizations == 0  # what another fit has asked costs nothing more
    monkeypatch.setattr(Setup, "spent", NO_COST)
    without = fitted(coarse, overrides=override).counts
    assert counted.factorizations - without.factorizations == 2 + 1
    assert counted.evaluations - without.evaluations == 1


def test_a_fine_mesh_is_not_spoken_of(coarse):
    rough = tuple(f"gauges.{name}.accuracy=5 mm" for name in ("CV", "R", "S"))
    found = fitted(coarse, overrides=("mesh.file=fine.inp", *rough))
    assert not any("mesh" in said for said in sentences_of(found.findings))
    assert found.gauges.errors == (None,) * 3


def test_only_a_mesh_that_is_too_coarse_asks_the_user_to_act():
    staged, _ = excavated("tri3", 4)
    found = mesh_error(staged, staged.case, NOTHING)
    everything = np.ones(found.error.shape, dtype=bool)
    for accuracy, acts in ((1e-6, True), (4e-4, False)):
        one = replace(found, accuracy=np.full(found.error.shape, accuracy), how="recovery")
        one = replace(one, notes=("How it was found.",))
        fit = in_fits.FittedMesh(one, everything, shift=1.0, counts=True)
        assert sentences_of(fit.findings) == ((fit.sentence,) if acts else ())
        assert fit.notes == (*(() if acts else (fit.sentence,)), *one.notes)
        unseen = replace(fit, counts=False)
        assert (sentences_of(unseen.findings), unseen.notes) == ((), ())
        assert "check CASE.fit.h5 --mesh-error" in fit.sentence  # at the fit, not at the start


def test_stages_in_which_the_finer_mesh_collapses_are_named():
    staged, _ = excavated("tri3", 2)
    found = mesh_error(staged, staged.case, NOTHING)
    twice = np.hstack([found.error, np.full_like(found.error, np.nan)])
    found = replace(found, error=twice, stages=("one", "two"), how="refinement")
    both = np.ones(twice.shape, dtype=bool)
    for counts in (False, True):
        (*_, said) = in_fits.FittedMesh(found, both, shift=1.0, counts=counts).notes
        assert "finds no equilibrium in 'two':" in said
    first = np.array([[True, False]] * len(twice))
    assert in_fits.FittedMesh(found, first, shift=0.0, counts=False).notes == ()


def test_gauges_better_than_stated_notice_the_mesh(coarse):
    """Stated as 100 mm, read to 0.05 mm ten times: only the estimate tells that the mesh counts."""
    path = coarse.with_name("readings.csv")
    head, *rows = path.read_text().splitlines()
    random = np.random.default_rng(1)
    parts = [row.split(",") for row in rows for _ in range(10)]
    several = [f"{c},{s},{float(v) + 0.05 * random.normal()!r},{u}" for c, s, v, u in parts]
    path.write_text("\n".join([head, *several]) + "\n")
    rough = tuple(f"gauges.{name}.accuracy=100 mm" for name in ("CV", "R", "S"))
    text = coarse.read_text().replace(
        "readings.csv", "{file: readings.csv, repeated_readings: all}"
    )
    coarse.write_text(text.replace("stages: [heading]", "stages: [heading], accuracies: estimate"))
    overrides = (*rough, "fit.model_error=none")
    blind = fitted(coarse, overrides=(*overrides, "fit.mesh_error=false")).parameters
    assert not blind.lower95[0] < 10e9 < blind.upper95[0]
    found = fitted(coarse, overrides=overrides)
    E = found.parameters
    assert E.lower95[0] < 10e9 < E.upper95[0]
    assert any(
        "The mesh is too coarse for these readings" in said for said in sentences_of(found.findings)
    )


def test_check_says_it_before_any_reading(coarse):
    run = CliRunner().invoke(geoident, ["check", str(coarse), "--mesh-error"])
    assert run.exit_code == 0
    assert "Every edge halved: 180 elements became 720" in run.stdout
    assert "Computed at the start values of the parameters" in " ".join(run.stdout.split())
    assert "The mesh is too coarse for these readings" in " ".join(run.stdout.split())
    run = CliRunner().invoke(geoident, ["check", str(coarse), "--mesh-error", "--json"])
    entry = json.loads(run.stdout)
    assert entry["how"] == "refinement"
    assert entry["counts"]["factorizations"] == 2 * 2  # two stages on both meshes
    assert entry["counts"]["evaluations"] == 2
    assert entry["readings"][0]["share"] == pytest.approx(
        abs(entry["readings"][0]["error"]) / entry["readings"][0]["accuracy"]
    )
    E = fitted(coarse, overrides=("fit.backtest=false",)).parameters.values[0]
    result = str(coarse.with_name("case.fit.h5"))
    again = CliRunner().invoke(geoident, ["check", result, "--mesh-error", "--json"])
    other = json.loads(again.stdout)
    assert other["notes"][0] == "Computed at the parameters of the fit."
    size = {(r["gauge"], r["stage"]): r["error"] for r in entry["readings"]}
    at_fit = {(r["gauge"], r["stage"]): r["error"] for r in other["readings"]}
    for place, error in at_fit.items():  # motions go with 1 / E
        assert error == pytest.approx(size[place] * 5e9 / E, rel=1e-6)
