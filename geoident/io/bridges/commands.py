"""Command lines by which other programs run geoident, as they stand in their files."""

from __future__ import annotations


def for_pest(case: str, values: str, computed: str) -> str:
    """The model command of PEST.

    Args:
        case: path of the case, seen from the folder of the files.
        values: name of the table of values that PEST writes.
        computed: name of the table of readings that it reads.
    """
    return f"geoident simulate {case} --values {values} -o {computed} --force -q"


def for_dakota(case: str) -> str:
    """The analysis driver of Dakota, which adds the names of its two files.

    Args:
        case: path of the case, seen from the folder of the files.
    """
    return f"geoident simulate {case} -q --dakota"
