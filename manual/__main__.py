"""Renew what is made in the manual: ``python -m manual [PART...]``, all parts if none is named."""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

from geoident.io.docs.case_schema import key_page_text
from manual.pages import DOCS, read_page
from manual.transcript import renew, run_page


def keys() -> None:
    """The page of all keys of a case."""
    (DOCS / "keys.md").write_text(key_page_text(), encoding="utf-8")


def tutorial(name: str) -> Callable[[], None]:
    """Outputs, files and pictures of a tutorial."""

    def run() -> None:
        page = read_page(DOCS / "tutorials" / f"{name}.md")
        with tempfile.TemporaryDirectory() as folder:
            renew(page, run_page(page, Path(folder)))

    return run


TUTORIALS = tuple(sorted(path.stem for path in (DOCS / "tutorials").glob("*.md")))

PARTS: dict[str, Callable[[], None]] = {
    "keys": keys,
    **{f"tutorials/{name}": tutorial(name) for name in TUTORIALS},
}


def main(words: list[str]) -> None:
    """Renew the parts that are named, or all.

    Raises:
        SystemExit: there is no such part.
    """
    if unknown := [word for word in words if word not in PARTS]:
        raise SystemExit(f"no part {unknown[0]}; there are {', '.join(PARTS)}")
    for name in words or PARTS:
        print(name, flush=True)
        PARTS[name]()


if __name__ == "__main__":
    main(sys.argv[1:])
