"""What decides what a run gives, as one number."""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from pathlib import Path

from geoident.errors import Fault, InputError, Location


def digest_of(said: Sequence[str], files: Sequence[str]) -> str:
    """SHA-256 of texts and of the contents of files.

    Args:
        said: the texts.
        files: paths.

    Raises:
        InputError: a file cannot be read.
    """
    total = hashlib.sha256()
    for text in said:
        total.update(hashlib.sha256(text.encode("utf-8", "surrogateescape")).digest())
    for path in files:
        try:
            with Path(path).open("rb") as file:
                total.update(hashlib.file_digest(file, "sha256").digest())
        except OSError as error:
            message = f"the file of the model cannot be read: {error.strerror or error}"
            fault = Fault("unreadable-file", message, location=Location(path))
            raise InputError([fault]) from error
    return total.hexdigest()
