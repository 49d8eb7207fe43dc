"""A file of geoident in place of another: one fault that says what it is, not one for each key."""

import pytest

from geoident.errors import InputError
from geoident.io.campaign.file import read_campaign
from geoident.io.case.file import read_case
from geoident.io.cluster.file import read_cluster
from geoident.io.project.file import read_project

READERS = {
    "case": read_case,
    "campaign": read_campaign,
    "project": read_project,
    "cluster": read_cluster,
}


@pytest.mark.parametrize("expected", READERS)
@pytest.mark.parametrize("given", READERS)
def test_a_file_of_another_kind_is_one_fault(tmp_path, given, expected):
    path = tmp_path / "file.yaml"
    path.write_text(f"title: mine\nformat: geoident-{given}/1\nparameters: {{}}\nsections: []\n")
    with pytest.raises(InputError) as error:
        READERS[expected](str(path))
    faults = error.value.faults
    if given == expected:
        assert all(fault.code != "other-kind" for fault in faults)
        return
    assert [(fault.code, fault.location.line, fault.location.column) for fault in faults] == [
        ("other-kind", 2, 9)
    ]
    assert f"this file is a {given}" in faults[0].message
    assert faults[0].hint
