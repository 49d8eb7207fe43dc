"""Makes readings.csv: the truth on another mesh, plus noise. Run: python make_readings.py."""

import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent))

from truth_readings import make_readings  # noqa: E402

make_readings(HERE, mesh=("--size", 0.333), seed=1)
