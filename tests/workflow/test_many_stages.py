"""Many stages: what is said of each alone is said once of all."""

from __future__ import annotations

import csv
import io

import numpy as np
import pytest
from support.commands import run_command
from support.convergence import CASE, write_law

from geoident.io.result.file import read_result
from geoident.workflow.check import check

LAW = {"X": "9 m", "m": "1.6", "T": "3 days", "n": "0.5"}


def only_size(text):
    """The law with its size sought alone."""
    lines = text.splitlines(keepends=True)
    lines = [line for line in lines if not line.startswith(tuple(f"  {name}: {{" for name in LAW))]
    return "".join(lines).replace("X: $X", "X: 9 m").replace("m: $m", "m: 1.6").replace(
        "T: $T", "T: 3 days").replace("n: $n", "n: 0.5")  # fmt: skip


def test_predicted_stages_are_scored_in_one_sentence(tmp_path):
    """Of five stages and two gauges; counted by hand."""
    path = write_law(tmp_path, only_size(CASE))
    drawn = run_command("simulate", path, "--noise", "--seed", 4).stdout
    read = {(row["gauge"], row["stage"]): 1e-3 * float(row["value"])
            for row in csv.DictReader(io.StringIO(drawn)) if row["stage"] != "first"}  # fmt: skip
    path = write_law(tmp_path, only_size(CASE) + "fit: {stages: [second]}\n", read)
    done = run_command("fit", path)
    assert done.exit_code == 0, done.output
    result = read_result(str(tmp_path / "case.fit.h5"))
    (note,) = [note for note in result.notes if note.startswith("Predicted stage")]
    bands, measured = result.prediction, result.gauges.measured
    known = np.isfinite(bands.mean) & np.isfinite(measured)
    inside = known & (measured >= bands.lower95) & (measured <= bands.upper95)
    assert known.sum() == 10
    assert note.startswith(f"Predicted stages: 5 were read, {inside.sum()} of 10 readings inside")
    rms = np.sqrt(np.mean(((measured - bands.mean) / bands.sd)[known] ** 2))
    assert f"RMS of the standardized residuals {rms:.2f};" in note


@pytest.mark.parametrize("late", [2, 4])
def test_stages_with_late_readings_are_noted_once(tmp_path, late):
    days = ["2024-03-03", "2024-03-09", "2024-03-21", "2024-04-11", "2024-06-30"][:late]
    rows = [f"{day};{1.0 + k};{0.5 + k}" for k, day in enumerate(days)]
    (tmp_path / "r.csv").write_text("\n".join(["date;H (mm);V (mm)", *rows]) + "\n")
    described = 'readings: {file: r.csv, layout: wide, delimiter: ";"}\n'
    path = write_law(tmp_path, only_size(CASE) + described)
    notes = [n for n in check(str(path)).summary.notes if "its date is too late" in n
             or "is too late." in n]  # fmt: skip
    assert len(notes) == (late if late < 4 else 1)
    if late == 4:
        assert "8 readings of 4 stages were taken nearer to the end of the next stage" in notes[0]
