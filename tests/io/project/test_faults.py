"""What is wrong with a project: all at once, with line and column, and what would be right."""

import pytest
from support.projects import SECTIONS, example

from geoident.errors import InputError
from geoident.workflow.project.plan import ProjectRequest, plan_project


def faults_of(folder, text):
    path = example(folder, text)
    with pytest.raises(InputError) as found:
        plan_project(ProjectRequest(path))
    return str(found.value).replace(f"{folder}/", "")


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("case: section.yaml, covariates: {GSI: 45}", "case: none.yaml, covariates: {GSI: 45}",
         "project.yaml:6:21: sections[2].case: there is no file"),
        ("covariates: {GSI: 52}", "covariates: {gsi: 52}",
         "project.yaml:5:74: sections[1].covariates: GSI is not given for this section"),
        ("covariates: {GSI: 52}", "covariates: {GIS: 52}", "Write 'GSI' in place of 'GIS'"),
        (", covariates: {GSI: 52}", "",
         "project.yaml:5:5: sections[1]: GSI is not given for this section"),
        ("GSI: 52", "GSI: 52 m",
         "sections[1].covariates.GSI: '52 m' is a length; elsewhere GSI is a number without unit"),
        ("shared: [K0]", "shared: [K1]",
         "project.yaml:7:10: shared[0]: the case of the section 'A' has no parameter 'K1'"),
        ("b * GSI", "b * GSJ", "'GSJ' is neither a covariate of the sections nor a constant of"),
        ("b * GSI", "b * E_rock", "the law of 'E_rock' refers to itself"),
        ("b * GSI", "b * K0", "the law of 'E_rock' refers to the parameter 'K0'"),
        ("b * GSI", "GSI", "the formula 'a * exp(GSI)' has no 'b'"),
        ("a * exp", "a * * exp", "project.yaml:10:14: laws.E_rock.formula"),
        ("a * exp(b", "a * exq(b", "there is no function 'exq'"),
        ("name: B", "name: A", "two sections are called 'A'"),
        ("shared: [K0]", "shared: [K0, E_rock]", "'E_rock' is shared and has a law"),
        ("shared: [K0]", "shared: [K0, K0]", "'K0' is given twice"),
        ("scatter: none", "scatter: 2 GPa", "a number without unit is expected"),
        ("scatter: none", "scatter: nine", "Did you mean 'none'?"),
        ("scatter: none", "scatter: -20 %", "a standard deviation is above zero"),
        ("start: 1 GPa, bounds: [0.01 GPa, 20 GPa]", "start: 1, bounds: [0.01, 20]",
         "the law gives"),
        ("readings: km-1.csv}", "readings: km-1.csv, parameters.K0.bounds: [0.5, 2.5]}",
         "the bounds of 'K0' differs from that of the section 'A'"),
        ("readings: km-2.csv}", "readings: km-2.csv, in_situ.vertical: 8}",
         "project.yaml:5:79: in_situ.vertical: '8'"),
        ("readings: km-2.csv}", "readings: km-2.csv, 'parameters[': 8}", "is not the path"),
        ("readings: km-2.csv}", "readings: km-2.csv, fit.loss: huber}", "has a robust loss"),
        ("shared: [K0]", "shared: []", "'K0' of the predicted section 'C' has no law or prior"),
        ("sections:", "section:", "Did you mean 'sections'?"),
        ("geoident-project/1", "geoident-project/2", "geoident-project/1"),
    ],
)  # fmt: skip
def test_a_fault_is_said_where_it_is(tmp_path, old, new, said):
    assert old in SECTIONS
    assert said in faults_of(tmp_path, SECTIONS.replace(old, new, 1))


def test_all_faults_of_a_project_are_said_at_once(tmp_path):
    text = (
        SECTIONS.replace("name: B", "name: A").replace("GSJ", "GSI").replace("b * GSI", "c * GSI")
    )
    said = faults_of(tmp_path, text)
    assert "two sections" in said
    assert "'c' is neither a covariate" in said
    assert "has no 'b'" in said


def test_nothing_in_common_is_no_project(tmp_path):
    text = SECTIONS[: SECTIONS.index("shared:")]
    assert "nothing is common to the sections" in faults_of(tmp_path, text)


def test_a_project_with_all_sections_left_out_has_nothing_to_fit(tmp_path):
    text = SECTIONS.replace("{GSI: 34}}", "{GSI: 34}, predict: true}")
    text = text.replace("{GSI: 52}}", "{GSI: 52}, predict: true}")
    assert "there is no section to fit" in faults_of(tmp_path, text)


def test_first_the_project_is_judged_and_then_the_cases_of_all_sections(tmp_path):
    text = SECTIONS.replace("km-1.csv}", "km-1.csv, gauges.EX0.zero: nowhere}")
    text = text.replace("km-2.csv}", "km-2.csv, gauges.EX90.zero: elsewhere}")
    wrong = text.replace("scatter: none", "scatter: nine").replace("title: Two", "titel: Two")
    found = faults_of(
        tmp_path, wrong.replace("case: section.yaml, covariates", "case: none.yaml, covariates")
    )
    assert "Did you mean 'none'?" in found
    assert "Did you mean 'title'?" in found
    assert "sections[2].case: there is no file" in found
    assert "nowhere" not in found
    found = faults_of(tmp_path, text.replace("shared: [K0]", "shared: [K1]"))
    assert "project.yaml:4:" in found
    assert "nowhere" in found
    assert "project.yaml:5:" in found
    assert "elsewhere" in found


def test_what_is_left_out_as_wrong_is_no_fault_of_others(tmp_path):
    text = SECTIONS.replace("GSI: 34", "GSI: many").replace("start: 1 GPa", "start: [1 GPa]")
    found = faults_of(tmp_path, text)
    assert found.count("project.yaml:") == 2, found
