"""geoident from Python: the same steps as the commands, with the same files.

    from geoident import fit, load_case, predict

    case = load_case("case.yaml")
    result = fit(case)
    print(result)                       # the outcome, as the command says it
    result.parameters["E_rock"].value   # SI
    result.gauges.to_frame()            # pandas, in the units of the case
    result.plot.overview()              # matplotlib
    later = predict(result, stages=["bench 3"])

A result of the same input is kept; one of other input of the same case is set aside beside it
(case.fit.1.h5) unless ``force`` says that it may go.
Numbers are in SI units; tables and data frames in the units of the case, which stand beside them.
What is wrong is raised as an error of `geoident.errors`, with all faults of the input and with
remedies in terms of Python.
"""

from geoident.api.calling import AnyPath, Progress
from geoident.api.campaigns import CampaignResult, batch
from geoident.api.cases import (
    CaseFile,
    CheckResult,
    SimulationResult,
    check,
    init,
    load_case,
    simulate,
    trust,
)
from geoident.api.files import compare, export, report
from geoident.api.plots import Drawing
from geoident.api.projects import ProjectFit, SectionFit, fit_project, read_project
from geoident.api.reduced import KeptModel, ReducedReadings
from geoident.api.results import (
    BacktestResult,
    ControlResult,
    FitResult,
    ModelChoice,
    PlanResult,
    PredictionResult,
    ResultFile,
    SampleResult,
    ScanResult,
    read_result,
)
from geoident.api.runs import backtest, fit, plan, predict, sample, scan, update
from geoident.api.safety import SafetyResult, safety
from geoident.api.service import control
from geoident.api.tables import (
    ChannelReadings,
    GaugeReadings,
    ParameterEstimate,
    Parameters,
    ResultTable,
)

__all__ = [
    "AnyPath",
    "BacktestResult",
    "CampaignResult",
    "CaseFile",
    "ChannelReadings",
    "CheckResult",
    "ControlResult",
    "Drawing",
    "FitResult",
    "GaugeReadings",
    "KeptModel",
    "ModelChoice",
    "ParameterEstimate",
    "Parameters",
    "PlanResult",
    "PredictionResult",
    "Progress",
    "ProjectFit",
    "ReducedReadings",
    "ResultFile",
    "ResultTable",
    "SafetyResult",
    "SampleResult",
    "ScanResult",
    "SectionFit",
    "SimulationResult",
    "backtest",
    "batch",
    "check",
    "compare",
    "control",
    "export",
    "fit",
    "fit_project",
    "init",
    "load_case",
    "plan",
    "predict",
    "read_project",
    "read_result",
    "report",
    "safety",
    "sample",
    "scan",
    "simulate",
    "trust",
    "update",
]
