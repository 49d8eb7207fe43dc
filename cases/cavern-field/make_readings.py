"""Makes readings.csv: a field drawn on another mesh, plus noise. Run: python make_readings.py."""

import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path.insert(0, str(HERE.parent))

from truth_readings import make_readings  # noqa: E402

make_readings(
    HERE,
    mesh=("--size", 0.6),
    seed=1,
    case="field.yaml",
    changes=("materials.rock.E.field.modes=800",),  # the truth knows no end of the modes
    flags=("--draw",),
)
