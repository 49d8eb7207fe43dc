"""A newcomer gets a case that works, or one for their own mesh that says what is missing."""

import re
from dataclasses import replace
from importlib.resources import files
from pathlib import Path

import numpy as np
import pytest
from support.meshes import box

from geoident.fem.kinematics import kinematics_of
from geoident.fem.location import Locator
from geoident.fem.measure import summarize_mesh
from geoident.io.case.file import read_case
from geoident.io.docs.skeleton import name_text, skeleton
from geoident.io.docs.templates import TEMPLATES
from geoident.io.mesh.file import read_mesh
from geoident.io.text.yaml_reader import parse_yaml
from geoident.model.case import Analysis
from geoident.model.in_situ import GeostaticStress
from tests.support.trench import CASE, READINGS, write_mesh

MESHLESS = ("opening",)
WITH_TUTORIAL = ("twin-tunnels",)
OF_NEWCOMERS = ("cavern", "opening")


@pytest.fixture
def here(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_templates_are_listed_and_nothing_is_written(here, run):
    said = run("init", "--list")
    assert (said.exit_code, [line.split()[0] for line in said.stdout.splitlines()]) == (
        0,
        list(TEMPLATES),
    )
    assert list(here.iterdir()) == []


@pytest.mark.parametrize("name", TEMPLATES)
class TestTemplate:
    def test_it_is_shipped_with_its_geometry(self, name):
        folder = files("geoident") / "templates" / name
        expected = {"case.yaml", "readings.csv"}
        expected |= set() if name in MESHLESS else {f"{name}.geo", f"{name}.msh"}
        expected |= {"TUTORIAL.md"} if name in WITH_TUTORIAL else set()
        assert {item.name for item in folder.iterdir()} == expected

    def test_its_lines_are_short_and_its_comments_explain(self, here, run, name):
        run("init", ".", "--template", name)
        lines = Path("case.yaml").read_text(encoding="utf-8").splitlines()
        assert max(map(len, lines)) <= 120
        assert sum(line.lstrip().startswith("#") for line in lines) >= 20


@pytest.mark.parametrize(
    "name", [n if n == "dam" else pytest.param(n, marks=pytest.mark.slow) for n in TEMPLATES
             if n not in (*WITH_TUTORIAL, *OF_NEWCOMERS)]
)  # fmt: skip
def test_its_fit_converges_and_predicts_the_stage_that_was_left_out(here, run, name):
    """One with a tutorial is in `test_tutorial`, that of newcomers in `test_newcomer`.

    That each is valid: `test_picture`. With the error of the mesh and the backtest, as it comes:
    the slow tests of `test_newcomer`.
    """
    made = run("init", "new", "--template", name)
    assert made.exit_code == 0
    assert made.stdout.splitlines()[0] == "new/case.yaml"
    assert all(Path(file).exists() for file in made.stdout.splitlines())
    assert "geoident fit new/case.yaml" in made.stderr
    lean = ("--set", "fit.mesh_error=false", "--set", "fit.backtest=false")
    done = run("fit", "new/case.yaml", *lean)
    assert done.exit_code == 0, done.stderr
    assert "readings inside" in " ".join(run("show", "new/case.fit.h5").stdout.split())


def test_nothing_is_overwritten_unless_asked(here, run):
    Path("readings.csv").write_text("mine")
    refused = run("init")
    assert refused.exit_code == 6
    assert "readings.csv: exists already; nothing was written" in refused.stderr
    assert "--force" in refused.stderr
    assert [item.name for item in here.iterdir()] == ["readings.csv"]
    assert run("init", "--force").exit_code == 0
    assert Path("readings.csv").read_text() != "mine"


def test_the_schema_is_written_where_it_is_asked_for(here, run):
    """It is larger than all the rest together."""
    plain = run("init", "plain").stdout.splitlines()
    assert [Path(file).name for file in plain] == [
        "case.yaml",
        "cavern.geo",
        "cavern.msh",
        "readings.csv",
    ]
    assert "$schema" not in Path("plain/case.yaml").read_text(encoding="utf-8")
    with_schema = run("init", "other", "--schema").stdout.splitlines()
    assert "other/case.schema.json" in with_schema
    first = Path("other/case.yaml").read_text(encoding="utf-8").splitlines()[0]
    assert first == "# yaml-language-server: $schema=case.schema.json"
    assert run("check", "other/case.yaml", "-q").exit_code == 0


class TestFromMesh:
    @pytest.fixture
    def case(self, here, run) -> Path:
        write_mesh(here / "trench.inp")
        done = run("init", "site", "--from", "trench.inp")
        assert done.exit_code == 0, done.stderr
        assert "replace every FILL_IN" in done.stderr
        return here / "site" / "case.yaml"

    def test_the_numbers_of_the_mesh_are_there(self, case):
        text = case.read_text(encoding="utf-8")
        assert "35 nodes and 24 elements (24 quad4)" in text
        assert "x 0 .. 6, y 0 .. 4 m" in text
        assert "rock: FILL_IN # 20 elements, 20 m2" in text
        assert "upper: FILL_IN # 2 elements, 2 m2, x 2 .. 4, y 3 .. 4 m" in text
        data = parse_yaml(text, "case.yaml").data
        assert data["mesh"] == {"file": "../trench.inp"}
        assert set(data["groups"]) == {"rock", "upper", "lower"}

    def test_nothing_is_guessed(self, case):
        data = parse_yaml(case.read_text(encoding="utf-8"), "case.yaml").data
        assert data["supports"] == "FILL_IN"
        assert set(data["groups"].values()) == {"FILL_IN"}
        assert "# left: x   # 5 nodes" in case.read_text(encoding="utf-8")

    def test_check_names_all_that_is_left(self, case, run):
        told = run("check", case)
        assert told.exit_code == 3
        paths = [line.split(": ")[1] for line in told.stderr.splitlines() if "replaced" in line]
        assert paths == [
            "materials.ground.E", "materials.ground.nu", "materials.ground.density", "groups.rock",
            "groups.upper", "groups.lower", "supports", "in_situ.K0", "stages", "gauges",
        ]  # fmt: skip
        assert f"{case}:" in told.stderr

    def test_filled_in_it_is_valid(self, case, run):
        text = case.read_text(encoding="utf-8")
        for name in ("rock", "upper", "lower"):
            text = text.replace(f"{name}: FILL_IN", f"{name}: ground")
        text = text.replace("E: FILL_IN", "E: 1 GPa").replace("nu: FILL_IN", "nu: 0.3")
        text = text.replace("density: FILL_IN", "density: 1900 kg/m3")
        text = text.replace("K0: FILL_IN", "K0: 0.5")
        text = text.replace("supports: FILL_IN", "supports: {bottom: fixed, left: x, right: x}")
        text = text.replace("stages: FILL_IN", "stages: [{name: dig, excavate: [upper]}]")
        text = text.replace("gauges: FILL_IN", "gauges: {}")
        case.write_text(text, encoding="utf-8")
        told = run("check", case)
        assert told.exit_code == 0, told.stderr
        assert "out of balance" not in told.stdout
        filled = read_case(str(case)).case
        assert filled.stages[0].excavate == ("upper",)
        assert filled.gravity == (0.0, -9.81)  # not commented out: the stress is its weight
        assert isinstance(filled.in_situ, GeostaticStress)

    def test_the_points_that_it_proposes_are_in_the_mesh(self, case):
        """And what it proposes to excavate is a small group."""
        text = case.read_text(encoding="utf-8")
        mesh = read_mesh(str(case.parent.parent / "trench.inp"), dim=2)
        locator = Locator(mesh)
        proposed = text.partition("gauges:")[2]
        found = re.findall(r"\[([-0-9.e]+) m, ([-0-9.e]+) m\]", proposed)
        assert len(found) >= 5
        for point in {(float(x), float(y)) for x, y in found}:
            assert locator.sites(point)[0].outside < 0.0
        assert "# - {name: upper, excavate: [upper]}" in text

    def test_a_heading_is_proposed_before_a_smaller_bench(self, here, run):
        write_mesh(here / "trench.inp")
        mesh = Path("trench.inp").read_text()
        Path("mine.inp").write_text(mesh.replace("=rock", "=Heading"))
        run("init", "site", "--from", "mine.inp")
        text = Path("site/case.yaml").read_text(encoding="utf-8")
        assert "# - {name: Heading, excavate: [Heading]}" in text

    def test_a_mesh_in_millimetres_is_suspected(self, here, run):
        write_mesh(here / "trench.inp")
        nodes, rest = Path("trench.inp").read_text().split("*ELEMENT", 1)
        rows = [line.split(",") for line in nodes.splitlines()[1:]]
        large = [f"{n}, {1e3 * float(x)}, {1e3 * float(y)}, 0" for n, x, y, _ in rows]
        Path("mm.inp").write_text("\n".join(["*NODE", *large, "*ELEMENT" + rest]))
        run("init", "site", "--from", "mm.inp")
        text = Path("site/case.yaml").read_text(encoding="utf-8")
        assert "the mesh is 6000 m by 4000 m large" in text
        Path("mm.yaml").write_text(CASE.replace("trench.inp", "mm.inp"))
        Path("readings.csv").write_text(READINGS)
        said = " ".join(run("check", "mm.yaml").stdout.split())
        assert "if they are millimetres, scale it by 0.001" in said
        outside = CASE.replace("trench.inp", "mm.inp").replace("[1 m, 4 m]", "[-900 m, 4 m]")
        Path("mm.yaml").write_text(outside)
        refused = " ".join(run("check", "mm.yaml").stderr.split())
        assert "lies outside the mesh" in refused
        assert "if they are millimetres" in refused

    def test_a_mesh_that_is_none(self, here, run):
        refused = run("init", "--from", "nothing.msh")
        assert refused.exit_code == 3
        assert "nothing.msh" in refused.stderr
        assert list(here.iterdir()) == []

    def test_a_template_and_a_mesh_exclude_each_other(self, here, run):
        assert run("init", "--from", "x.msh", "--template", "dam").exit_code == 2


def test_a_solid_mesh_makes_a_solid_analysis(here, run):
    run("init", "--template", "tunnel")
    run("init", "mine", "--from", "tunnel.msh")
    text = Path("mine/case.yaml").read_text(encoding="utf-8")
    assert "analysis: solid" in text
    assert "# symmetry: x   # 456 surfaces, x = 0, y -18 .. 36, z -35 .. 35 m" in text
    assert "# top   # 57 surfaces" in text


def test_both_sides_in_one_group_are_proposed_to_be_held_across():
    mesh = box("quad4", (3, 2), size=(6.0, 4.0))
    sides = np.concatenate([mesh.facet_groups["x0"], mesh.facet_groups["x1"]])
    mesh = replace(mesh, facet_groups={"sides": sides, "base": mesh.facet_groups["y0"]})
    summary = summarize_mesh(mesh, kinematics_of(Analysis.PLANE_STRAIN))
    text = skeleton(summary, mesh_file="m.msh", title="soil")
    assert "# sides: x   # 4 edges, x 0 .. 6, y 0 .. 4 m: both sides of the model" in text
    assert "# base: y   # 3 edges, x 0 .. 6, y = 0 m: an edge of the model" in text


@pytest.mark.parametrize("name", ["no", "12", "a: b", "#a", "x y", "on", "[a", "é", "a/b.msh", "-"])
def test_names_of_a_mesh_come_back_from_yaml(name):
    assert parse_yaml(f"k: {name_text(name)}", "x").data == {"k": name}
