"""Runs written as a table are read again; whatever a file of others holds, faults have places."""

import csv
import io

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from geoident.errors import InputError
from geoident.io.bridges.dakota import read_request
from geoident.io.bridges.values import read_values
from geoident.io.external.pest_instructions import read_instructions
from geoident.io.external.run_table import read_run_table
from geoident.io.external.templates import read_template
from geoident.model.gauges import Channel
from geoident.model.parameter import Parameter

QUICK = settings(max_examples=25, deadline=None, suppress_health_check=list(HealthCheck))
PARAMETERS = {
    "E": Parameter("E", start=15e9, lower=1e9, upper=1e11, dimension="pressure", unit="GPa"),
    "K0": Parameter("K0", start=1.0, lower=0.1, upper=3.0),
}
CHANNELS = [
    Channel(name, name, "convergence", (0.0, 0.0), (4.0, 0.0), (1.0, 0.0), 1e-4, "virgin")
    for name in ("roof", 'side, "left"')
]
STAGES = ["heading", "bench 1"]
SIZES = {"GPa": 1e9, "MPa": 1e6, "mm": 1e-3, "cm": 1e-2}


@QUICK
@given(data=st.data(), bracket=st.sampled_from(["[]", "()"]))
def test_a_table_gives_the_runs_that_were_written(data, bracket, tmp_path):
    n = data.draw(st.integers(9, 14))
    random = np.random.default_rng(data.draw(st.integers(0, 1000)))
    pressure, length = (data.draw(st.sampled_from(u)) for u in (("GPa", "MPa"), ("mm", "cm")))
    begin, end = bracket
    heads = [f"E {begin}{pressure}{end}", "K0"]
    heads += [f"{c.name} @ {stage} {begin}{length}{end}" for c in CHANNELS for stage in STAGES]
    numbers = random.uniform(0.5, 2.0, (n, len(heads)))
    delimiter, decimal = data.draw(st.sampled_from([(",", "."), (";", ","), ("\t", ".")]))
    order = data.draw(st.permutations(range(len(heads))))
    written = io.StringIO()
    writer = csv.writer(written, delimiter=delimiter, lineterminator="\n")
    writer.writerow(["run", *(heads[k] for k in order)])
    for number, row in enumerate(numbers):
        writer.writerow([number, *(repr(float(row[k])).replace(".", decimal) for k in order)])
    path = tmp_path / "runs.csv"
    path.write_text("# made by a script\n" + written.getvalue())
    found = read_run_table(str(path), PARAMETERS, CHANNELS, STAGES, [])
    assert not found.faults
    at = [found.runs.names.index(name) for name in PARAMETERS]
    expected = numbers[:, :2] * [SIZES[pressure], 1.0]
    np.testing.assert_allclose(found.runs.values[:, at], expected, rtol=1e-14)
    readings = numbers[:, 2:].reshape(n, 2, 2).transpose(0, 2, 1) * SIZES[length]
    np.testing.assert_allclose(found.runs.readings, readings, rtol=1e-14)


def run_table(path):
    return read_run_table(path, PARAMETERS, CHANNELS, STAGES, []).faults


READERS = {
    "runs": (run_table, ["E [GPa],K0,roof @ bench 1 [mm]", "1,2,3", "nan", "E;K0", "roof [mm]"]),
    "values": (read_values, ["parameter,value,unit", "E,5,GPa", "K0,1.5D0,", "1,2,3"]),
    "request": (read_request, ["1 variables", "5.0 E", "1 functions", "3 ASV_1:x", "{ a = 1 }"]),
    "instructions": (
        lambda path: read_instructions(path)[1],
        ["pif ~", "l1 !a!", "~text~ [b]1:9", "& (c)3:4", "w t5", "~", "!dum!"],
    ),
    "template": (
        lambda path: read_template(path, "deck", PARAMETERS)[1],
        ["ptf ~", "~  e  ~", "{{E [GPa]:10.3e}}", "{{ K0 }}", "{{", "}}", "{{E [mm]}}"],
    ),
}


@pytest.mark.parametrize("kind", list(READERS))
@QUICK
@given(data=st.data())
def test_any_lines_end_with_faults_that_have_a_place(kind, data, tmp_path):
    read, usual = READERS[kind]
    lines = st.lists(st.sampled_from(usual) | st.text(max_size=12), max_size=8)
    path = tmp_path / "file"
    path.write_bytes("\n".join(data.draw(lines)).encode("utf-8", "ignore"))
    try:
        found = read(str(path))
        faults = [] if kind in ("values", "request") else found
    except InputError as error:
        faults = error.faults
    assert all(fault.location.file == str(path) for fault in faults)
    assert all(fault.message for fault in faults)
