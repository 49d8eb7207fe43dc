"""What the keys of the errors of model and mesh refuse, and the remedy they name."""

import pytest


@pytest.mark.parametrize(
    ("written", "message", "hint"),
    [
        ("model_error: 15", "between 0 and 200 %", "Did you mean '15 %'?"),
        ("model_error: -5 %", "between 0 and 200 %", "are usual"),
        ("model_error: 1000 %", "between 0 and 200 %", "are usual"),
        ("model_error: no", "'no' is not", "Did you mean 'none'?"),
        ("model_error: estimated", "'estimated' is not", "Did you mean 'estimate'?"),
        ("model_error: rough", "'rough' is not", "Write it such as 15 %."),
        ("mesh_error: maybe", "found 'maybe'; expected true or false", "Write true or false"),
        ("reduced: kept", "found 'kept'; expected true, false or keep", "Write one of them"),
    ],
)
def test_refusals(project, changed, written, message, hint):
    fault = project.only_fault(
        changed("method: gauss-newton,", f"method: gauss-newton, {written},")
    )
    assert message in fault.message
    assert hint in fault.hint
