"""ARCHITECTURE.md speaks of files that exist, and no modules import each other."""

from __future__ import annotations

import re
from graphlib import TopologicalSorter
from pathlib import Path

import geoident

PACKAGE = Path(geoident.__file__).parent
ROOT = Path(__file__).parents[2]
MODULES = [path.relative_to(PACKAGE) for path in PACKAGE.rglob("*.py")]


def test_files_named_in_architecture_exist() -> None:
    text = (PACKAGE / "ARCHITECTURE.md").read_text(encoding="utf-8")
    named = set(re.findall(r"`((?:\w+/)*\w+\.py)`", text))
    known = "\n".join(
        f"/{path.relative_to(ROOT).as_posix()}"
        for folder in ("geoident", "tests")
        for path in (ROOT / folder).rglob("*.py")
    )
    assert named
    wanted = {name: re.escape(f"/{name}").replace("NAME", r"\w+") + "$" for name in named}
    assert not [n for n, pattern in wanted.items() if not re.search(pattern, known, re.MULTILINE)]


def test_classes_named_in_architecture_exist() -> None:
    text = (PACKAGE / "ARCHITECTURE.md").read_text(encoding="utf-8")
    named = set(re.findall(r"`([A-Z][a-z]\w+)`", text))
    code = "".join((PACKAGE / path).read_text(encoding="utf-8") for path in MODULES)
    assert named <= set(re.findall(r"(?:class|def) (\w+)\b", code))


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
