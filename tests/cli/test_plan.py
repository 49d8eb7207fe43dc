"""The command that chooses gauges: what it prints and writes."""

import json

from tests.support.trench import CASE

GAUGES = """\
gauges:
  T: {kind: convergence, between: [[2 m, 2.5 m], [4 m, 2.5 m]], accuracy: 0.01 mm, cost: 2}
  U: {kind: settlement, point: [1.5 m, 4 m], accuracy: 0.01 mm, stages: first}
"""


def test_screen_json_and_tables_tell_the_same(trench, run):
    text = CASE.replace("readings: readings.csv\n", "").replace("stages: [first], ", "")
    (trench / "case.yaml").write_text(text)
    (trench / "gauges.yaml").write_text(GAUGES)
    words = ("plan", "case.yaml", "--candidates", "gauges.yaml", "--budget", 2, "--draws", 1)
    done = run(*words, "--for", "CV > -2 mm at second", "--for", "E", "--json")
    assert done.exit_code == 0
    told = json.loads(done.stdout)
    assert (told["kind"], told["output"]) == ("plan", "case.plan.h5")
    plan = told["plan"]
    assert [one["text"] for one in plan["targets"]] == ["CV > -2 mm at second", "E"]
    assert (plan["budget"], plan["draws"], plan["model_error"]) == (2.0, 2, 0.15)
    first, other = plan["gauges"]
    assert (first["rank"], other["rank"]) == (1, 0)
    assert plan["cost"] == first["cost"]
    assert all(0.0 <= one["adds"] <= one["alone"] + 1e-9 <= 1.0 for one in plan["gauges"][:1])
    assert plan["targets"][1]["sd_plan"] < plan["targets"][1]["sd_case"] < plan["targets"][1]["sd"]
    again = run(*words, "--for", "CV > -2 mm at second", "--for", "E", "--json")
    assert json.loads(again.stdout)["plan"] == plan
    shown = run("show", "case.plan.h5").stdout
    for expected in (
        "Gauges to take",
        "A model error of 15 %",
        "CV, S, X of the case count as read",
    ):
        assert expected in shown
    table = run("export", "case.plan.h5", "--table", "plan").stdout.splitlines()
    assert table[1].startswith(f"{first['gauge']},{first['kind']},{first['cost']:g},1,")
    targets = run("export", "case.plan.h5", "--table", "plan-targets").stdout
    assert "E," in targets
