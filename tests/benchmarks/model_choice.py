"""Which model of a ladder is taken, on readings of each of its models: a table.

    python tests/benchmarks/model_choice.py [--runs 20] [--accuracy "0.03 mm"]... [--fit "..."]

A block of rock is pushed and sheared on its faces (`tests/support/jacking.py`). Rows: what made the
readings. Columns: what was taken, and how often the readings could tell. The size of the model
error is estimated, as by default (up to 9 s a run); with `--fit "model_error: none"` a run takes
less than a second.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from support.jacking import LADDER, TRUTHS, write_case, write_readings  # noqa: E402

from geoident import api  # noqa: E402


def chosen(rung: str, accuracy: str, seed: int, fit: str) -> tuple[str, bool]:
    """What was taken on readings of a model, and whether the readings could tell."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        truth = write_case(folder, rock=rung, name="truth.yaml", accuracy=accuracy)
        write_readings(truth, TRUTHS[rung], seed)
        extra = f", {fit}" if fit else ""
        case = write_case(folder, accuracy=accuracy, fit=f"{{ladder: {LADDER}{extra}}}")
        found = api.fit(str(case)).data.comparison
        assert found is not None
        return found.models[found.chosen].name, found.decided


def options(parser: argparse.ArgumentParser) -> None:
    """Add what the table can be told."""
    parser.add_argument("--runs", type=int, default=20)
    parser.add_argument("--accuracy", action="append")
    parser.add_argument("--fit", default="", help="more keys of fit, such as 'loss: huber'")
    parser.add_argument("--seed", type=int, default=0, help="of the first run")


def table(given: argparse.Namespace) -> Iterator[str]:
    """Lines of the table in markdown."""
    yield ("| accuracy | readings of | " + " | ".join(TRUTHS) + " | could tell |")
    yield "|---" * (len(TRUTHS) + 3) + "|"
    seeds = range(given.seed, given.seed + given.runs)
    for accuracy in given.accuracy or ["0.03 mm", "0.06 mm", "0.2 mm"]:
        for rung in TRUTHS:
            found = [chosen(rung, accuracy, seed, given.fit) for seed in seeds]
            counts = [sum(name == other for name, _ in found) for other in TRUTHS]
            told = sum(decided for _, decided in found)
            yield f"| {accuracy} | {rung} | {' | '.join(map(str, counts))} | {told} |"


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    options(parser)
    for line in table(parser.parse_args(arguments)):
        print(line, flush=True)


if __name__ == "__main__":
    main()
