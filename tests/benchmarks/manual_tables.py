"""All tables of measured numbers in the documents, as markdown.

    python tests/benchmarks/manual_tables.py                       # all of them, an hour or more
    python tests/benchmarks/manual_tables.py wrong-models --runs 30 --set estimate
    python tests/benchmarks/manual_tables.py cavern --cavern-runs 6
    python tests/benchmarks/manual_tables.py model-choice --runs 5 --accuracy "0.06 mm"
    python tests/benchmarks/manual_tables.py fields --modes 100

Before each table stand the command, the version of geoident, those of the libraries that compute,
and seed and number of runs, so that a table in a document says how it came about. The same command
with the same versions makes the same table, but for the seconds in that of the fields.

    wrong-models   coverage of bands where the ground is not like its model (docs/wrong_models.md)
    cavern         the same on cases/cavern
    model-choice   which model of a ladder is taken (theory 12.3)
    fields         what a field costs (theory 10.6)
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1]))

import fields
import model_choice
import wrong_models
from support.versions import versions

TABLES: dict[str, Callable[[argparse.Namespace], Iterable[str]]] = {
    "wrong-models": lambda given: wrong_models.tables(given, cavern=False),
    "cavern": lambda given: wrong_models.tables(given, cavern=True),
    "model-choice": model_choice.table,
    "fields": lambda given: fields.table(given.modes),
}


def _field_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--modes", type=int, nargs="+", default=[100, 200])


OPTIONS: dict[str, Callable[[argparse.ArgumentParser], None]] = {
    "wrong-models": wrong_models.options,
    "cavern": wrong_models.options,
    "model-choice": model_choice.options,
    "fields": _field_options,
}


def made_by(name: str, given: argparse.Namespace) -> str:
    """How a table comes about: command with all options, and versions.

    Args:
        name: of the table.
        given: its options.
    """
    options = {key: value for key, value in vars(given).items() if key != "kept"}
    said = " ".join(f"{key}={value}" for key, value in sorted(options.items()))
    return f"`manual_tables.py {name}` with {said}; {', '.join(versions())}"


def show(name: str, given: argparse.Namespace) -> None:
    """Print a table, line by line as it is computed."""
    print(f"{made_by(name, given)}\n", flush=True)
    for line in TABLES[name](given):
        print(line, flush=True)
    print(flush=True)


def main(arguments: Sequence[str] | None = None) -> None:
    """Command line: the name of a table and its options, or nothing for all of them."""
    words = list(sys.argv[1:] if arguments is None else arguments)
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("table", nargs="?", choices=list(TABLES), help="all without it")
    named = parser.parse_args(words[:1]).table
    for name in [named] if named else list(TABLES):
        own = argparse.ArgumentParser(prog=f"manual_tables.py {name}")
        OPTIONS[name](own)
        show(name, own.parse_args(words[1:]))


if __name__ == "__main__":
    main()
