"""ARCHITECTURE.md speaks of files that exist, and no folder grows beyond what a reader takes in."""

from __future__ import annotations

import re
from collections import Counter
from graphlib import TopologicalSorter
from pathlib import Path

import geoident

PACKAGE = Path(geoident.__file__).parent
ROOT = Path(__file__).parents[2]
MODULES = [path.relative_to(PACKAGE) for path in PACKAGE.rglob("*.py")]
MOST_MODULES = 17


def test_files_named_in_architecture_exist() -> None:
    text = (PACKAGE / "ARCHITECTURE.md").read_text(encoding="utf-8")
    named = set(re.findall(r"`((?:\w+/)*\w+\.py)`", text))
    known = "\n".join(
        f"/{path.relative_to(ROOT).as_posix()}"
        for folder in ("geoident", "tests")
        for path in (ROOT / folder).rglob("*.py")
    )
    assert len(named) > 80
    wanted = {name: re.escape(f"/{name}").replace("NAME", r"\w+") + "$" for name in named}
    assert not [n for n, pattern in wanted.items() if not re.search(pattern, known, re.MULTILINE)]


def test_classes_named_in_architecture_exist() -> None:
    text = (PACKAGE / "ARCHITECTURE.md").read_text(encoding="utf-8")
    named = set(re.findall(r"`([A-Z][a-z]\w+)`", text))
    code = "".join((PACKAGE / path).read_text(encoding="utf-8") for path in MODULES)
    assert len(named) > 10
    assert named <= set(re.findall(r"(?:class|def) (\w+)\b", code))


def test_folders_hold_no_more_modules_than_a_reader_takes_in() -> None:
    modules = Counter(path.parent for path in MODULES if path.name != "__init__.py")
    assert not {str(path): n for path, n in modules.items() if n > MOST_MODULES}


def test_no_modules_import_each_other() -> None:
    """Not for their types either: of two modules one is read first."""
    names = {".".join(("geoident", *path.with_suffix("").parts)): path for path in MODULES}
    names = {name.removesuffix(".__init__"): path for name, path in names.items()}
    line = re.compile(r"^ *from (geoident[\w.]*) import (\([^)]*\)|.*)", re.MULTILINE)
    imports: dict[str, set[str]] = {}
    for name, path in names.items():
        text = (PACKAGE / path).read_text(encoding="utf-8")
        for module, imported in line.findall(text):
            for word in re.findall(r"\w+", imported):
                within = f"{module}.{word}"
                imports.setdefault(name, set()).add(within if within in names else module)
    assert len(imports) > 300
    tuple(TopologicalSorter(imports).static_order())  # raises `CycleError` with the modules
