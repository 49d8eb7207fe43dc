"""The page on programs as models: its files are a case that runs as it says."""

import re
import sys
from pathlib import Path

import geoident
from geoident.workflow.fit import fit
from geoident.workflow.programs.trust import decided_by, trusting
from geoident.workflow.running.control import Control
from geoident.workflow.running.jobs import Request, plan_fit

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
