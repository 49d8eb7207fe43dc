"""How accurate a gauge is: what may be written, what it is built into, and what is refused."""

import numpy as np
import pytest

from geoident.errors import InputError
from geoident.io.case.file import parse_case
from geoident.io.case.gauges.accuracy import TYPICAL
from geoident.model.gauges import Reading
from geoident.workflow.estimating.accuracies import with_accuracies
from geoident.workflow.running.readings import error_structure
from tests.support.trench import CASE, write_case

X = "anchors: {a: [1 m, 3 m]}, accuracy: 0.01 mm"


@pytest.fixture(autouse=True)
def folder(tmp_path, monkeypatch):
    write_case(tmp_path)
    monkeypatch.chdir(tmp_path)


def read(text):
    found = parse_case(text, "case.yaml").case
    return {channel.name: channel for channel in found.channels}


def with_accuracy(words):
    return CASE.replace(X, f"anchors: {{a: [1 m, 3 m]}}, accuracy: {words}")


def refused(text):
    with pytest.raises(InputError) as caught:
        read(text)
    return caught.value.faults


def test_a_quantity_means_independent_readings():
    assert read(CASE)["X.a"].errors is None
    assert read(CASE)["X.a"].accuracy == 1e-5


def test_parts_are_read_and_what_is_missing_is_usual():
    channel = read(with_accuracy("{reading: 0.2 mm, epoch: 0 mm, along: 0.5 mm/sqrt(m)}"))["X.a"]
    parts = channel.errors
    assert (parts.reading, parts.zero, parts.epoch) == (2e-4, 2e-4, 0.0)
    assert parts.head == TYPICAL["extensometer"].head
    assert parts.along == pytest.approx(5e-4)
    assert channel.accuracy == parts.total(channel.along)
    assert parts.estimated == ()


def test_a_root_of_feet_is_converted():
    parts = read(with_accuracy("{reading: 1 mm, along: 0.01 in/sqrt(ft)}"))["X.a"].errors
    assert parts.along == pytest.approx(2.54e-4 / 0.3048**0.5)


@pytest.mark.parametrize(
    ("words", "components"),
    [
        ("estimate", {"reading": "extensometer: reading"}),
        (
            "{reading: estimate}",
            {"reading": "extensometer: reading", "zero": "extensometer: reading"},
        ),
        ("{reading: 1 mm, head: estimate}", {"head": "extensometer: head"}),
        (
            "{zero: estimate, reading: estimate}",
            {"reading": "extensometer: reading", "zero": "extensometer: zero"},
        ),
    ],
)
def test_what_is_to_be_estimated(words, components):
    channel = read(with_accuracy(words))["X.a"]
    assert dict(channel.errors.estimated) == components
    assert channel.errors.reading > 0.0
    assert (channel.dimension, channel.unit) == ("length", "mm")


def test_kinds_are_estimated_by_a_common_factor():
    text = with_accuracy("{reading: 1 mm, zero: 2 mm, head: 0 mm}")
    some = read(text.replace("fit: {", "fit: {accuracies: {extensometer: estimate}, "))
    assert some["CV"].errors is None
    assert dict(some["X.a"].errors.estimated) == dict.fromkeys(("reading", "zero"), "extensometer")
    assert some["X.a"].errors.zero == 2e-3
    everything = read(text.replace("fit: {", "fit: {accuracies: estimate, "))
    assert dict(everything["CV"].errors.estimated) == {"reading": "convergence"}


CASING = "[[1 m, 4 m], [1 m, 1 m]]"


@pytest.mark.parametrize("reads_as", ["cumulated", "incremental"])
def test_errors_of_an_inclinometer_add_up_along_what_is_cumulated(reads_as):
    gauge = f"I: {{kind: inclinometer, casing: {CASING}, depths: [0, 1, 2.5 m], "
    gauge += f"reads_as: {reads_as}, accuracy: {{zero: 0 mm, along: 0.2 mm/sqrt(m)}}}}"
    found = read(
        CASE.replace("readings: readings.csv\n", "").replace("gauges:", "gauges:\n  " + gauge)
    )
    rows = [(found[f"I.A{d}"], Reading(f"I.A{d}", "first", 0.0)) for d in ("0", "1", "2.5")]
    structure = error_structure(rows)
    B = structure.columns.toarray()
    length = [3.0, 2.0, 0.5] if reads_as == "cumulated" else [1.0, 1.5, 0.5]
    walk = np.minimum.outer(length, length) if reads_as == "cumulated" else np.diag(length)
    np.testing.assert_allclose(structure.sd, TYPICAL["inclinometer"].reading)
    np.testing.assert_allclose(B @ B.T, 4e-8 * walk, atol=1e-20)
    assert found["I.A0"].accuracy == pytest.approx((1e-8 + 4e-8 * length[0]) ** 0.5)


@pytest.mark.parametrize(
    ("words", "path", "message"),
    [
        ("{reading: 0.1 kPa}", "reading", "'0.1 kPa' is a pressure; expected a length"),
        ("{reading: 0 mm}", "reading", "the reading error must exceed zero"),
        ("{reading: 1 mm, zero: -1 mm}", "zero", "'-1 mm' is negative"),
        ("{reading: 1 mm, along: 1 mm}", "along", "such as 0.2 mm/sqrt(m)"),
        ("{reading: 1 mm, along: 1 mm/sqrt(s)}", "along", "such as 0.2 mm/sqrt(m)"),
        ("{reeding: 1 mm}", "reeding", "the key 'reeding' is not known here"),
        ("0 mm", "", "it must be positive"),
        ("1e-30 mm", "", "'1e-30 mm' is an implausible accuracy for a gauge"),
        ("1e-9 mm", "", "'1e-9 mm' is an implausible accuracy for a gauge"),
        ("1 km", "", "'1 km' is an implausible accuracy for a gauge"),
        ("{reading: 1e-9 mm}", "reading", "'1e-9 mm' is an implausible accuracy for a gauge"),
        ("guess", "", "'guess' is not a number with a unit"),
    ],
)
def test_what_is_wrong_is_said_at_its_key(words, path, message):
    (fault,) = refused(with_accuracy(words))
    assert message in fault.message
    assert fault.path == ".".join(filter(None, ["gauges.X.accuracy", path]))
    assert fault.location.line == 19
    assert fault.hint


def test_what_no_gauge_of_a_kind_has_is_said_with_what_is_usual():
    (fault,) = refused(with_accuracy("1e-9 mm"))
    assert fault.hint == "Gauges of the kind extensometer have about 0.1 mm; is it another unit?"
    assert read(with_accuracy("0.001 um"))["X.a"].accuracy == 1e-9  # strange, but check says so


def test_estimated_kinds_must_exist_and_the_loss_must_be_squared():
    text = CASE.replace("fit: {", "fit: {accuracies: {extensometr: estimate}, loss: huber, ")
    (fault,) = refused(text)
    assert "there is no kind of gauge 'extensometr'" in fault.message
    assert "Did you mean 'extensometer'" in fault.hint
    (fault,) = refused(text.replace("extensometr:", "extensometer:"))
    assert fault.path == "fit.loss"
    assert "accuracies cannot be estimated with the loss 'huber'" in fault.message
    assert "bad" in fault.hint


SURVEYED = (
    "  L: {kind: levelling, points: {P: [-5, 0 m], Q: [5, 0 m]}, survey: monday, "
    "accuracy: {reading: 0.3 mm, epoch: 0.4 mm}}\n"
    "  S: {kind: settlement, point: [0, 0 m], survey: monday, "
    "accuracy: {reading: 0.2 mm, epoch: 0.5 mm}}\n"
)


@pytest.mark.parametrize("kinds", ["estimate", "{levelling: estimate}", "{settlement: estimate}"])
def test_gauges_of_two_kinds_have_one_factor_on_the_set_up_they_share(project, changed, kinds):
    text = changed("readings: readings.csv", SURVEYED + "readings: readings.csv")
    text = text.replace("stages: [bench 1]", f"stages: [bench 1], accuracies: {kinds}")
    case = project.read(text).case
    shared = {c.name: c.errors for c in case.channels if c.errors and c.errors.survey}
    assert set(shared) == {"L.P", "L.Q", "S"}
    (factor,) = {parts.component("epoch") for parts in shared.values()}
    sized = with_accuracies(case, {factor: 3.0})
    found = {c.name: c.errors.epoch for c in sized.channels if c.name in shared}
    assert found == pytest.approx({"L.P": 1.2e-3, "L.Q": 1.2e-3, "S": 1.5e-3})
