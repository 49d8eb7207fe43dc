# %% [markdown]
# A notebook as a script: every `# %%` begins a cell (VS Code, Spyder, jupytext). It also runs as it
# is, `python cases/notebook.py`, on the small cavern that `geoident init` writes.

# %% A case to work with
import tempfile
from pathlib import Path

import numpy as np

from geoident import fit, load_case, predict
from geoident.workflow.init import init_template

folder = Path(tempfile.mkdtemp(prefix="geoident-"))
init_template("cavern", str(folder), force=False)
case = load_case(folder / "case.yaml")
print(case.case.title)
print("stages: ", ", ".join(stage.name for stage in case.case.stages))
print("gauges: ", ", ".join(channel.name for channel in case.case.channels))

# %% Find the rock. The result also stands in a file, as if `geoident fit` had been called.
found = fit(case, progress=lambda step: print(f"  {step.number}: {step.objective:.6g}"))
for name, parameter in found.parameters.items():
    interval = f"{parameter.lower95:.4g} .. {parameter.upper95:.4g}"
    print(f"{name:8} {parameter.value:.4g} {parameter.unit} ({interval})")

# %% Measured against computed, mm
for stage, (measured, computed) in found.readings("EX-P.w1").items():
    print(f"EX-P.w1 after {stage:8} {1e3 * measured:7.2f} {1e3 * computed:7.2f}")

# %% The stage that is still to come, with its band
later = predict(found, stages=["bench 2"])
prediction, gauges = later.result.prediction, later.result.gauges
assert prediction is not None
column = gauges.stages.index("bench 2")
for row in np.flatnonzero(np.isfinite(prediction.mean[:, column])):
    mean = prediction.mean[row, column]
    low, high = prediction.lower95[row, column], prediction.upper95[row, column]
    print(f"{gauges.channels[row]:9} {1e3 * mean:7.2f} mm ({1e3 * low:.2f} .. {1e3 * high:.2f})")

# %% Does the answer depend on where the search began?
other = load_case(folder / "case.yaml", {"parameters.E_rock.start": "60 GPa"})
again = fit(other, output=folder / "other.h5")
change = again.parameters["E_rock"].value / found.parameters["E_rock"].value - 1
print(f"from 60 GPa the modulus changes by {100 * change:.1e} %")
