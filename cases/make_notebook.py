"""Write notebook.ipynb, for Jupyter, from notebook.py: `python cases/make_notebook.py`."""

import json
import re
from pathlib import Path

HERE = Path(__file__).parent
CELL = re.compile(r"^# %%(.*)\n", re.M)


def cells(script):
    """Kind and text of every cell of a script; a title of a cell of code stays as a comment."""
    parts = CELL.split(script)[1:]
    for head, body in zip(parts[::2], parts[1::2], strict=True):
        title = head.strip()
        if title == "[markdown]":
            yield "markdown", re.sub(r"^# ?", "", body.strip(), flags=re.M)
        else:
            yield "code", "\n".join(filter(None, [f"# {title}" if title else "", body.strip()]))


def notebook(script):
    """The text of the notebook, without outputs."""
    found = []
    for number, (kind, text) in enumerate(cells(script)):
        cell = {"cell_type": kind, "id": f"cell-{number}", "metadata": {}}
        if kind == "code":
            cell |= {"execution_count": None, "outputs": []}
        found.append(cell | {"source": text.splitlines(keepends=True)})
    python = {"display_name": "Python 3", "language": "python", "name": "python3"}
    metadata = {"kernelspec": python, "language_info": {"name": "python"}}
    whole = {"cells": found, "metadata": metadata, "nbformat": 4, "nbformat_minor": 5}
    return json.dumps(whole, indent=1, ensure_ascii=False) + "\n"


if __name__ == "__main__":
    script = (HERE / "notebook.py").read_text(encoding="utf-8")
    (HERE / "notebook.ipynb").write_text(notebook(script), encoding="utf-8")
