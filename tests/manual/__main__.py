"""Renew what is made in the manual: ``sh tests/manual/renew [PART...]``.

All parts are made if none is named, but for the readings of the tutorial of the tunnel, which
are given: ``sh tests/manual/renew tutorials/tunnel/readings``. Of the gallery, which takes an hour,
single cases can be named: ``sh tests/manual/renew gallery/cavern gallery/template-dam``.
"""

from __future__ import annotations

import sys
import tempfile
from collections.abc import Callable
from functools import partial
from pathlib import Path

from geoident.io.docs.campaign_schema import campaign_key_page_text
from geoident.io.docs.case_schema import key_page_text
from geoident.io.docs.project_schema import project_key_page_text
from manual import gallery, tunnel_readings, verification
from manual.commands import command_page
from manual.drawings import DRAWINGS, svg
from manual.pages import DOCS, page_name, pages_that_are_run, read_page
from manual.transcript import renew, run_page


def keys() -> None:
    """The pages of all keys of a case, of a campaign and of a project."""
    (DOCS / "keys.md").write_text(key_page_text(), encoding="utf-8")
    (DOCS / "campaign_keys.md").write_text(campaign_key_page_text(), encoding="utf-8")
    (DOCS / "project_keys.md").write_text(project_key_page_text(), encoding="utf-8")


def commands() -> None:
    """The page of all commands."""
    (DOCS / "commands.md").write_text(command_page(), encoding="utf-8")


def drawings() -> None:
    """The drawings of the conventions."""
    for name, draw in DRAWINGS.items():
        (DOCS / f"{name}.svg").write_bytes(svg(draw))


def page_that_is_run(path: Path) -> Callable[[], None]:
    """Outputs, files and pictures of a page with commands."""

    def run() -> None:
        page = read_page(path)
        with tempfile.TemporaryDirectory() as folder:
            renew(page, run_page(page, Path(folder)))

    return run


PARTS: dict[str, Callable[[], None]] = {
    "keys": keys,
    "commands": commands,
    "drawings": drawings,
    "verification": verification.main,
    "verification/pages": verification.write,
    "gallery": gallery.write,
    **{page_name(path): page_that_is_run(path) for path in pages_that_are_run()},
}

GIVEN: dict[str, Callable[[], None]] = {
    "tutorials/tunnel/readings": tunnel_readings.main,
    **{gallery.part_name(one): partial(gallery.write_one, one) for one in gallery.shown()},
}
"""What is made only when it is named."""


def main(words: list[str]) -> None:
    """Renew the parts that are named, or all.

    Raises:
        SystemExit: there is no such part.
    """
    parts = PARTS | GIVEN
    if unknown := [word for word in words if word not in parts]:
        raise SystemExit(f"no part {unknown[0]}; there are {', '.join(parts)}")
    for name in words or PARTS:
        print(name, flush=True)
        parts[name]()


if __name__ == "__main__":
    main(sys.argv[1:])
