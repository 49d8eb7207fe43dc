"""What is said of the model error goes with the interval that stands beside it."""

import json

import pytest
from support.commands import run_command
from support.external import OWN, gauge_values


@pytest.mark.parametrize("off", [1.0, 1.3, 2.0])
def test_what_the_residuals_leave_possible_is_not_called_hardly_shown(tmp_path, off):
    """One reading is too large: what is said of the model error goes with its interval."""
    values = {(g, s): v for (g, s), v in gauge_values(8e9, 0.9).items() if s == "open"}
    rows = ["gauge,stage,value,unit"]
    for share, stage in zip((0.2, 0.4, 0.6, 0.8), ("a", "b", "c", "d"), strict=True):
        for (gauge, _), value in values.items():
            wrong = off if (gauge, stage) == ("D", "c") else 1.0
            read = 1e3 * share * value * wrong + 0.01 * (-1) ** len(rows)
            rows.append(f"{gauge}.a,{stage},{read:.4f},mm")
    text = OWN.replace("  model_error: none\n", "")
    text = text.replace("{name: half, excavate: [tunnel], release: {tunnel: 0.5}}",
                        "{name: a, excavate: [tunnel], release: {tunnel: 0.2}}")  # fmt: skip
    more = "".join(f"  - {{name: {s}, release: {{tunnel: {r}}}}}\n" for s, r in
                   (("b", 0.4), ("c", 0.6), ("d", 0.8)))  # fmt: skip
    text = text.replace("  - {name: open, ", more + "  - {name: open, ")
    (tmp_path / "case.yaml").write_text(text)
    (tmp_path / "readings.csv").write_text("\n".join(rows) + "\n")
    ended = run_command("fit", tmp_path / "case.yaml", "--json", "-q")
    error = json.loads(ended.stdout)["model_error"]
    hardly = "hardly show a model error" in error["sentence"]
    assert hardly == (error["lower95"] <= 0.01 and error["upper95"] <= 0.3), error
