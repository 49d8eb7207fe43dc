"""A small program of a user, which `mypy --strict` takes as it is (`test_types.py`)."""

from pathlib import Path

from geoident import (
    CaseFile,
    FitResult,
    ScanResult,
    check,
    compare,
    export,
    fit,
    load_case,
    predict,
    read_result,
    report,
    scan,
    simulate,
)
from geoident.errors import GeoidentError, InputError


def study(path: Path, ratios: list[float]) -> dict[float, float]:
    """Modulus by Poisson's ratio."""
    case: CaseFile = load_case(path)
    print(check(case).summary.used, case.stages)
    found: dict[float, float] = {}
    for nu in ratios:
        result: FitResult = fit(
            case.with_values({"materials.rock.nu": nu}), output=path.with_name(f"{nu}.h5")
        )
        found[nu] = result.parameters["E"].value
    return found


def look(path: Path) -> str:
    """What stands in a result, and in what comes from it."""
    again = read_result(path)
    if not isinstance(again, FitResult):
        return again.status
    later = predict(again, stages=["second"])
    computed: float = float(later.gauges["CV"].computed.max())
    names: tuple[str, ...] = later.predictions.header
    drawing = again.plot.field("first", "displacement", section=1)
    drawing[0].set_title(f"{computed:.3f} {names}")
    drawing.figure.savefig(path.with_suffix(".png"))
    again.parameters.to_frame(si=True)
    estimate: float = float(again.to_xarray()["estimate"].max())
    choice: str = compare(again, later.path).chosen
    return f"{estimate} {choice} {report(again)} {export(again, ['csv'])}"


def grid(path: Path) -> int:
    """How many points a scan has, and how many readings a simulation."""
    try:
        found: ScanResult = scan(path, progress=lambda step: print(step.objective))
    except InputError as error:
        return len(error.faults)
    except GeoidentError:
        return 0
    return found.grid.objective.size + len(simulate(path, noise=True).readings)
