"""Files beside a result that were made of an earlier one: an export, a report.

They stay when the case is fitted again, since nobody has asked for new ones; who opens them next
should know of which result they are. ``RESULT.sha256`` in the folder of an export says it of each
file; a page has no room for it, so it is only known to be older when the result is new.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from geoident.io.text.mark import read_mark

_OF = "# Of the result "


def listed_files(text: str) -> dict[str, tuple[str, str]]:
    """Name of a file to its checksum and the identity of its result, empty where none is said.

    Args:
        text: of a list of checksums, as `listing_text` writes it.
    """
    listed: dict[str, tuple[str, str]] = {}
    identity = ""
    for line in text.splitlines():
        identity = line.removeprefix(_OF).strip() if line.startswith(_OF) else identity
        checksum, _, name = line.partition("  ")
        if name and not line.startswith("#"):
            listed[name] = checksum, identity
    return listed


def listing_text(files: Mapping[str, tuple[str, str]]) -> str:
    """A list of checksums that ``sha256sum --check`` reads, result by result.

    Args:
        files: name to checksum and identity of the result.
    """
    lines = []
    for identity in sorted({identity for _, identity in files.values()}):
        lines += [f"{_OF}{identity}"] if identity else []
        of_result = sorted((name, one) for name, (one, of) in files.items() if of == identity)
        lines += [f"{checksum}  {name}" for name, checksum in of_result]
    return "".join(f"{line}\n" for line in lines)


def older_files(path: Path, identity: str, *, new: bool) -> tuple[str, ...]:
    """Sentences on files beside a result that are of an earlier one, with how to make them again.

    Args:
        path: of the result.
        identity: its own.
        new: it has just come to its place.
    """
    stem = path.name.removesuffix(".h5")
    folder = path.with_name(f"{stem}.export")
    remarks = []
    try:
        listed = listed_files((folder / f"{stem}.sha256").read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError):
        listed = {}
    older = [name for name, (_, of) in listed.items() if of not in ("", identity)]
    older = [name for name in older if (folder / name).is_file()]
    if older:
        what = f"{len(older)} files" if len(older) > 1 else older[0]
        have = "are" if len(older) > 1 else "is"
        remarks.append(
            f"{what} in {folder} {have} of an earlier result: `geoident export {path}` makes "
            f"{'them' if len(older) > 1 else 'it'} again"
        )
    page = path.with_name(f"{stem}.html")
    try:
        made_here = new and read_mark(page.read_bytes(), "html") is not None
    except OSError:
        made_here = False
    if made_here:
        remarks.append(f"{page} shows an earlier result: `geoident report {path}` makes it again")
    return tuple(remarks)
