"""A parameter of which the readings tell nothing is said to be known only from its prior.

The judge is the prior itself: nothing depends on the density of a trench in a given stress.
"""

import json

import pytest
from support.commands import run_command
from support.trench import CASE, write_case

NARROW = (
    "{start: 2000 kg/m3, bounds: [500 kg/m3, 6000 kg/m3], prior: {mean: 2000 kg/m3, sd: 90 kg/m3}}"
)
LOG = NARROW.replace("start", "scale: log, start")
LOGNORMAL = LOG.replace("prior: {", "prior: {kind: lognormal, ")
BESIDE = NARROW.replace("mean: 2000", "mean: 700").replace("sd: 90", "sd: 150")
WIDE = NARROW.replace("[500 kg/m3, 6000 kg/m3]", "[1500 kg/m3, 2500 kg/m3]").replace(
    "90 k", "900 k"
)


def case_with(folder, density):
    path = write_case(folder)
    bounds = "bounds: [0.2, 4]}"
    text = CASE.replace("nu: 0.25}", "nu: 0.25, density: $d}")
    path.write_text(text.replace(bounds, f"{bounds}\n  d: {density}"))
    return path


def about_density(result):
    return [f["sentence"] for f in result["findings"] if "d" in f["subject"].split(", ")]


@pytest.mark.parametrize("density", [NARROW, LOG, LOGNORMAL, BESIDE])
def test_in_the_table_and_in_a_finding(tmp_path, density):
    ended = run_command("fit", case_with(tmp_path, density))
    assert ended.exit_code == 0
    (line,) = [line for line in ended.output.splitlines() if line.startswith("d ")]
    assert "as its prior" in line
    assert "The readings do not determine d: it is known only from its prior" in " ".join(
        ended.output.split()
    )


def test_a_prior_as_wide_as_the_bounds_is_none(tmp_path):
    ended = run_command("fit", case_with(tmp_path, WIDE))
    assert ended.exit_code == 4
    (line,) = [line for line in ended.output.splitlines() if line.startswith("d ")]
    assert "not determined" in line
    words = " ".join(ended.output.split())
    assert "determine d, and its prior is as wide as its bounds: only these limit it." in words


def test_by_draws_too(tmp_path):
    path = case_with(tmp_path, NARROW)
    run_command("fit", path, "-q")
    ended = run_command("sample", path.with_name("case.fit.h5"), "--json", "-q", "--draws", "400")
    result = json.loads(ended.stdout)
    assert about_density(result) == [
        "d is known only from its prior: the readings hardly add to it."
    ]
    assert not result["parameters"]["d"]["determined"]
