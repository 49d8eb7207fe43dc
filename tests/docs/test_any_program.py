"""The page on programs as models: its files are a case that runs as it says."""

import re
import sys
from pathlib import Path

import pytest

import geoident
from geoident.workflow.fit import fit
from geoident.workflow.programs.trust import decided_by, trusting
from geoident.workflow.running.control import Control
from geoident.workflow.running.jobs import Request, plan_fit
from geoident.workflow.simulate import simulate

PAGE = Path(geoident.__file__).parent / "docs" / "how-to" / "any-program.md"


def test_the_files_of_the_page_are_a_case(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    blocks = re.findall(r"```\w+\n# (\S+)\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    assert [name for name, _ in blocks] == ["opening.template", "opening.py", "case.yaml"]
    for name, text in blocks:
        (tmp_path / name).write_text(text.replace("[python3,", f"[{sys.executable}, -S,"))
    with decided_by(trusting(trust=True)):
        found = fit(plan_fit(Request(str(tmp_path / "case.yaml"))), Control()).result
    assert found.status == "converged"
    assert found.exit_code == 0


def test_the_template_may_be_that_of_pest(tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    blocks = re.findall(r"```\w+\n# (\S+)\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    for name, text in blocks:
        (tmp_path / name).write_text(text.replace("[python3,", f"[{sys.executable}, -S,"))
    pest = (PAGE.parent / "pest.md").read_text(encoding="utf-8")
    [template] = re.findall(r"```text\n(ptf .*?)```", pest, re.DOTALL)
    found = []
    for text in (blocks[0][1], template):
        (tmp_path / "opening.template").write_text(text)
        with decided_by(trusting(trust=True)):
            simulated = simulate(str(tmp_path / "case.yaml"))
        found.append([reading.value for reading in simulated.readings])
    assert found[1] == pytest.approx(found[0], rel=1e-7)
