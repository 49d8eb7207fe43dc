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


@pytest.mark.parametrize(
    ("name", "content", "found"),
    [
        ("mine.msh", b"$MeshFormat\n4.1 0 8\n", "a mesh"),
        ("mine", b"$MeshFormat\n4.1 1 8\n\x01\x00\x00\x00", "a mesh"),
        ("mine.inp", b"*Node\n1, 0, 0\n", "a mesh"),
        ("mine.csv", b"gauge,stage,value,unit\n", "a table"),
        ("mine.fit.h5", b"\x89HDF\r\n\x1a\n", "an HDF5 file, such as a result"),
    ],
)
def test_a_mesh_a_table_or_a_result_is_no_case(tmp_path, name, content, found):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(InputError) as error:
        read_case(str(tmp_path / name))
    (fault,) = error.value.faults
    assert fault.message == f"this file is {found}; expected a case"
    assert fault.hint


def test_a_case_may_have_any_name(tmp_path):
    (tmp_path / "case.csv").write_text("format: geoident-case/1\n")
    with pytest.raises(InputError) as error:
        read_case(str(tmp_path / "case.csv"))
    assert all(fault.code != "other-kind" for fault in error.value.faults)
