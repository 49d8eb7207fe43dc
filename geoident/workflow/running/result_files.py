"""The files that a result came from, as seen from where it lies, and what came from a fit."""

from __future__ import annotations

import os
from dataclasses import replace
from pathlib import Path

from geoident.errors import Term
from geoident.io.mesh.file import mesh_files
from geoident.io.result.file import read_identity
from geoident.io.text.named_files import files_of_text
from geoident.io.text.text_file import STDIN
from geoident.model.results.findings import Finding
from geoident.model.results.result import Result


def files_of_result(result: Result, path: str) -> tuple[str, ...]:
    """Paths of a result, of its case and of all files that the case names, as far as they exist.

    Args:
        result: holds the case.
        path: of its file.
    """
    case = case_path(path, result.provenance.case_file)
    texts = (result.case_text, result.case_resolved)
    named = [name for text in texts for name in files_of_text(text, case)]
    return tuple(dict.fromkeys((path, case, *(part for n in named for part in mesh_files(n)))))


def case_path(output: Path | str, case_file: str) -> str:
    """The case that a result was made from, as seen from here."""
    if Path(case_file).is_absolute():
        return case_file
    return os.path.normpath(Path(output).parent / case_file)


OF_FITS = ("predict", "sample", "control", "plan", "safety")
"""Kinds of results that are made from a fit."""


def why_outdated(result: Result, path: str) -> str:
    """A sentence where a result was made from an earlier fit than its file holds now; else empty.

    Args:
        result: of any kind.
        path: of its file.
    """
    origin = result.provenance
    if not origin.fit_file:
        return ""
    file = case_path(path, origin.fit_file)
    again = f"geoident {result.kind} {file}"
    if result.kind == "safety":
        again = f"geoident {Term.SAFETY} {file}"
    if result.kind == "plan":
        again += " ..."
    return outdated_words(file, origin.fit_fingerprint, again)


def outdated_words(fit: str, fingerprint: str, again: str) -> str:
    """A sentence where the file of a fit holds another one than before; else empty.

    Args:
        fit: path of its file.
        fingerprint: of the fit that was there.
        again: the command that makes again what came from it.
    """
    now = read_identity(fit)
    if now is None or now.fingerprint == fingerprint:
        return ""  # a fit that has gone says nothing
    return f"Outdated: made from an earlier fit than {fit} holds now. `{again}` makes it again."


def outdated_beside(fit: Result, path: str) -> tuple[str, ...]:
    """Paths of what stands beside a fit and was made from an earlier one: results and its page.

    Args:
        fit: the fit.
        path: of its file.
    """
    if fit.kind != "fit" or path == STDIN:
        return ()
    place = Path(path)
    stem = place.name.removesuffix(".h5").removesuffix(".fit")
    outdated = []
    for kind in OF_FITS:
        other = place.with_name(f"{stem}.{kind}.h5")
        made = read_identity(other) if other.is_file() else None
        ours = made is not None and os.path.normpath(made.fit_file) == place.name
        if made is not None and ours and made.fit_fingerprint != fit.fingerprint:
            outdated.append(str(other))
    page = place.with_name(place.name.removesuffix(".h5") + ".html")
    if _shows_another(page, fit.fingerprint):
        outdated.append(str(page))
    return tuple(outdated)


_SHOWN = b"fingerprint of the result"


def _shows_another(page: Path, fingerprint: str) -> bool:
    """Whether a page that geoident made shows the fingerprint of another result."""
    try:
        content = page.read_bytes() if page.is_file() else b""
    except OSError:
        return False
    return _SHOWN in content and fingerprint.encode() not in content


def with_outdated(result: Result, path: str) -> tuple[Result, tuple[str, ...]]:
    """A result that says first if it is of an earlier fit, and the paths of what is.

    Args:
        result: of any kind.
        path: of its file.

    Returns:
        The result; its own path, or the paths of what stands beside a fit.
    """
    reason = why_outdated(result, path)
    if reason:
        outdated = Finding("outdated", "", reason)
        return replace(result, findings=(outdated, *result.findings)), (path,)
    return result, outdated_beside(result, path)


def outdated_sentence(paths: tuple[str, ...]) -> str:
    """That files beside a fit are of an earlier one; empty for none.

    Args:
        paths: of the files.
    """
    if not paths:
        return ""
    are = "is of an earlier fit: make it" if len(paths) == 1 else "are of an earlier fit: make them"
    return f"{' and '.join(paths)} {are} again."
