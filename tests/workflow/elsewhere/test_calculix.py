"""CalculiX as the model, through its deck and its listing: the fit is that of geoident's own."""

import numpy as np
import pytest
from support.calculix import PROGRAM, REMEDY, write_first_stage
from support.cases import material, model, rollers
from support.external import trusted
from support.meshes import box, regroup

from geoident.identify.problem.methods import identify
from geoident.identify.problem.problem import Problem
from geoident.model.case import Stage
from geoident.model.gauges import Channel
from geoident.model.in_situ import HeimStress
from geoident.model.methods import GaussNewtonOptions
from geoident.model.parameter import Parameter, Scalar
from geoident.workflow.fit import fit
from geoident.workflow.running.control import Control
from geoident.workflow.running.jobs import Request, plan_fit

CASE = """\
format: geoident-case/1
model:
  kind: external
  command: [ccx, -i, cube]
  inputs: {{cube.inp: cube.template}}
  outputs:
{outputs}
parameters:
  E: {{start: 8 GPa, bounds: [1 GPa, 50 GPa], scale: log}}
  E_wall: {{start: 8 GPa, bounds: [1 GPa, 50 GPa], scale: log}}
gauges:
{gauges}
readings:
{readings}
fit: {{backtest: false}}
"""


def cube():
    """An eighth of a cube of rock with a cavern, and what moves on its wall."""
    mesh = regroup(
        box("hex20", (4, 4, 4), size=(4.0, 4.0, 4.0)),
        hole=lambda x: np.all(x < 1, 1),
        wall=lambda x: np.all(x < 2, 1),
    )
    parameters = (
        Parameter("E", start=8e9, lower=1e9, upper=50e9, scale="log", dimension="pressure"),
        Parameter("E_wall", start=8e9, lower=1e9, upper=50e9, scale="log", dimension="pressure"),
    )
    channels = tuple(
        Channel(name, name, "displacement", None, point, direction, 1e-5, "virgin")
        for name, point, direction in GAUGES
    )
    return model(
        mesh,
        materials={
            "rock": material("rock", Scalar(1.0, "E"), 0.25),
            "wall": material("wall", Scalar(1.0, "E_wall"), 0.25),
        },
        groups={"rock": "rock", "hole": "rock", "wall": "wall"},
        supports=rollers(3),
        in_situ=HeimStress(K0=Scalar(1.3), vertical=Scalar(6e6)),
        stages=(Stage("open", excavate=("hole",)),),
        parameters=parameters,
        channels=channels,
    )


GAUGES = (
    ("X", (1.0, 0.0, 0.0), (1.0, 0.0, 0.0)),
    ("Z", (0.0, 0.0, 1.0), (0.0, 0.0, 1.0)),
    ("XX", (2.0, 0.0, 0.0), (1.0, 0.0, 0.0)),
    ("ZZ", (0.0, 0.0, 2.0), (0.0, 0.0, 1.0)),
)


def node_at(staged, channel):
    """Number of the node at which a channel reads, as CalculiX counts."""
    away = np.linalg.norm(staged.mesh.points - np.array(channel.second), axis=1)
    assert away.min() < 1e-9
    return int(np.argmin(away)) + 1


@pytest.mark.slow  # another program than CalculiX: test_program.py
@pytest.mark.skipif(PROGRAM is None, reason=REMEDY)
def test_a_cube_with_a_cavern_is_identified_as_by_geoident(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    monkeypatch.setenv("OMP_NUM_THREADS", "1")
    staged = cube()
    write_first_stage(staged, tmp_path / "cube.inp", values={"E": 1.0, "E_wall": 2.0})
    text = (tmp_path / "cube.inp").read_text()
    for written, name in (("1.0", "E"), ("2.0", "E_wall")):
        assert text.count(f"*ELASTIC\n{written},0.25\n") == 1
        field = f"{{{{{name}:20.12e}}}}"
        text = text.replace(f"*ELASTIC\n{written},0.25\n", f"*ELASTIC\n{field},0.25\n")
    (tmp_path / "cube.template").write_text(text)

    pairs = [(channel.name, "open") for channel in staged.case.channels]
    truth = staged.response(pairs).readings(np.array([9e9, 5e9]))
    measured = np.round(1e3 * truth * [1.002, 0.997, 1.003, 1.0], 3)
    nodes = [node_at(staged, channel) for channel in staged.case.channels]
    lines = []
    for channel, node in zip(staged.case.channels, nodes, strict=True):
        word = 2 + int(np.argmax(np.abs(channel.direction)))
        lines.append(
            f"    - {{gauges: [{channel.name}], file: cube.dat, unit: m, "
            f'line: "^ +{node} +[-0-9]", word: {word}}}'
        )
    gauges = [f"  {c.name}: {{kind: reading, accuracy: 0.01 mm}}" for c in staged.case.channels]
    readings = [
        f"  - {{gauge: {c.name}, stage: end, value: {value} mm}}"
        for c, value in zip(staged.case.channels, measured, strict=True)
    ]
    parts = {"outputs": lines, "gauges": gauges, "readings": readings}
    case = tmp_path / "case.yaml"
    case.write_text(CASE.format(**{name: "\n".join(part) for name, part in parts.items()}))
    with trusted():
        found = fit(plan_fit(Request(str(case))), Control()).result

    problem = Problem(
        staged.response(pairs), 1e-3 * measured, np.full(4, 1e-5), staged.case.parameters
    )
    own = identify(problem, (GaussNewtonOptions(),), lambda iteration: None)
    assert own.objective > 0.1
    np.testing.assert_allclose(found.parameters.values, own.values, rtol=1e-4)
    np.testing.assert_allclose(found.objective, own.objective, rtol=1e-3)
