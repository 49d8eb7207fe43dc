# %% [markdown]
# # Rock around a cavern from its extensometers
#
# Every `# %%` begins a cell (VS Code, Spyder, jupytext); `cases/notebook.ipynb` is the same for
# Jupyter. It also runs as it is, `python cases/notebook.py`, on the small cavern that
# `geoident init` writes. Needs `pip install "geoident[notebook]"`.

# %%
import tempfile
from pathlib import Path

from geoident import check, compare, fit, init, predict, report, scan, simulate

# %% [markdown]
# ## A case
# `init` writes a small one with its mesh and its readings; yours is `load_case("my/case.yaml")`.

# %%
folder = Path(tempfile.mkdtemp(prefix="geoident-"))
case = init(folder, "cavern")
case

# %% Everything that can be wrong with it, before computing
checked = check(case)
print(checked)

# %%
checked.plot.model()

# %% [markdown]
# ## The rock
# The result also stands in a file, as if `geoident fit` had been called: the next call with the
# same input reads it. A notebook shows parameters and an overview.

# %%
result = fit(case, progress=lambda step: print(f"  {step.number}: {step.objective:.6g}"))
result

# %% As tables: in the units of the case, or `si=True`
result.parameters.to_frame()

# %%
gauges = result.gauges.to_frame()
worst = gauges.loc[(gauges["residual"] / gauges["sd"]).abs().idxmax()]
print(f"farthest off: {worst['channel']} after {worst['stage']}, {worst['residual']:.2f} mm")

# %% As numbers, SI
modulus = result.parameters["E_rock"]
print(f"E_rock is {modulus}, so {modulus.value:.3e} {modulus.unit}")
wall = result.gauges["EX-P.w1"]
for stage, measured, computed in zip(wall.stages, wall.measured, wall.computed, strict=True):
    print(f"EX-P.w1 after {stage:8} {1e3 * measured:7.2f} {1e3 * computed:7.2f} mm")

# %% As figures: axes of matplotlib, to be changed and saved
drawing = result.plot.field("bench 1")
drawing[0].axhline(0.0, color="black", lw=0.5)
drawing.figure.savefig(folder / "bench-1.png")
drawing

# %% As arrays with names
data = result.to_xarray()
settlement = data["displacement"].sel(axis="y") - data["displacement"].sel(axis="y", state="virgin")
print(f"the crown moves by {1e3 * float(settlement.min()):.1f} mm at most")

# %% [markdown]
# ## The stage that is still to come, with its band

# %%
later = predict(result, stages=["bench 2"])
later.predictions

# %% [markdown]
# ## What if
# `with_values` varies a case; the file stays as it is.

# %% Does the answer depend on where the search began?
again = fit(case.with_values({"parameters.E_rock.start": "60 GPa"}), output=folder / "other.fit.h5")
change = again.parameters["E_rock"].value / modulus.value - 1
print(f"from 60 GPa the modulus changes by {100 * change:.1e} %")

# %% Do the readings ask for the Poisson's ratio that the case gives?
stiff = fit(case.with_values({"materials.rock.nu": 0.35}), output=folder / "nu-0.35.fit.h5")
compare(result, stiff)

# %% Where else would the readings be met? The misfit over two parameters
valley = scan(case.with_values({"fit.scan.points": 5}))
valley.plot.parameters()

# %% What would the gauges read in softer rock?
soft = simulate(case.with_values({"parameters.E_rock.start": "5 GPa"}))
soft.to_frame().head()

# %% [markdown]
# ## The report: one page for the client

# %%
print(report(result))
