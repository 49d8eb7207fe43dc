"""What a fit of many channels costs, and how its cost grows with them.

    python tests/benchmarks/many_channels.py [--channels 500 1000 2000 5000 10000] [--stages 5]

prints for each number of channels of a levelling over a pit (3000 elements, three parameters, the
model error and all else as by default, the stage after the last predicted) processor seconds, the
same by those of the first number, and the largest memory. One thread; each fit in a process of its
own.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from tests.support.many_channels import cost_of_fit, write_many_channels


def main() -> None:
    """Prints the table."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--channels", type=int, nargs="+", default=[500, 1000, 2000, 5000, 10_000])
    parser.add_argument("--stages", type=int, default=5)
    parser.add_argument("--without-model-error", action="store_true")
    options = parser.parse_args()
    more = ["--set", "fit.model_error=none"] if options.without_model_error else []
    first = 0.0
    print("channels  readings  seconds  by the first  GB")
    with tempfile.TemporaryDirectory() as folder:
        for n in options.channels:
            case = write_many_channels(Path(folder) / str(n), n, options.stages)
            seconds, memory = cost_of_fit(case, *more)
            first = first or seconds
            readings = n * options.stages
            print(f"{n:8} {readings:9} {seconds:8.1f} {seconds / first:13.1f}  {memory / 1e9:.2f}")


if __name__ == "__main__":
    main()
