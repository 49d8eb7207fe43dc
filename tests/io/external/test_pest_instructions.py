"""Instruction files of PEST: figures of its manual, pyEMU on the same files, what is refused."""

import warnings
from pathlib import Path

import pytest
from support.external import EXTERNAL, PROGRAM, trusted, write_case

import geoident
from geoident.errors import InputError
from geoident.io.case.file import read_case
from geoident.io.external.pest_instructions import CannotFollow, observed, read_instructions
from geoident.workflow.fit import fit
from geoident.workflow.running.control import Control
from geoident.workflow.running.jobs import Request, plan_fit

with warnings.catch_warnings():
    warnings.simplefilter("ignore")
    from pyemu.pst.pst_utils import InstructionFile

VECTORS = """\
TIME PERIOD NO. 1 --->
SOLUTION VECTOR:
1.43253  6.43235  7.44532  4.23443  91.3425  3.39872
TIME PERIOD NO. 3 --->
SOLUTION VECTOR
2.09485  8.49021  9.39382  6.39920  79.9482  6.20983
"""
STEPS = """\
TIME STEP 10 (13 ITERATIONS REQUIRED) STRESS --->
X = 1.05 STRESS = 4.35678E+03
TIME STEP 10 (BACK SUBSTITUTION) STRAIN --->
X = 1.05 STRAIN = 2.56785E-03
X = 1.10 STRAIN = 2.34564E-03
"""
LISTING = """\
listing of a program

 D I S P L A C E M E N T S   (mm)
 node        ux          uy
    1   -1.2500E-01  3.4000E+00
    2    2.2500E-01 -1.4000E+00
 roof = -12.5, side = 4.75
MODEL OUTPUTS: 2.89988 4.487892 -4.59098 8.394843
"""


def both(tmp_path, instructions, output):
    """What we read, and what pyEMU reads."""
    (tmp_path / "o.ins").write_text(instructions)
    (tmp_path / "o.txt").write_text(output)
    lines, faults = read_instructions(str(tmp_path / "o.ins"))
    assert not faults
    own = {name: float(word) for name, word in observed(lines, output).items()}
    reader = InstructionFile(str(tmp_path / "o.ins"))
    frame = reader.read_output_file(str(tmp_path / "o.txt"))
    reader._ins_filehandle.close()  # which pyEMU leaves open
    reader._out_filehandle.close()
    return own, frame["obsval"].to_dict()


@pytest.mark.parametrize(
    ("instructions", "output", "expected"),
    [
        ("pif *\n*PERIOD NO. 3*\n*SOLUTION VECTOR*\nl1 [o1]1:7 [o2]10:16 [o6]46:52\n", VECTORS,
         {"o1": 2.09485, "o2": 8.49021, "o6": 6.20983}),
        ("pif *\n*PERIOD NO. 3*\n*SOLUTION VECTOR*\nl1 (o1)1:3 (o2)10:11 (o6)44:50\n", VECTORS,
         {"o1": 2.09485, "o2": 8.49021, "o6": 6.20983}),
        ("pif *\nl3 !a! !dum! w !b!\nl3 !C!\n", VECTORS,
         {"a": 1.43253, "b": 7.44532, "c": 2.09485}),
        ("pif %\n%TIME STEP 10% %STRAIN%\nl1 %STRAIN =% !s1!\nl1 %STRAIN =% !s2!\n", STEPS,
         {"s1": 2.56785e-3, "s2": 2.34564e-3}),
        ("pif %\nl2 %=% %=% !s!\n", STEPS, {"s": 4.35678e3}),
        ("pif ~\n~d i s p l a c e~\nl2 !dum! !ux1! !uy1!\nl1 w w !ux2! w !uy2!\n", LISTING,
         {"ux1": -0.125, "uy1": 3.4, "ux2": 0.225, "uy2": -1.4}),
        ("pif ~\nl5 [ux1]9:19 [uy1]22:31\nl2 ~roof =~ !roof! ~side~ ~=~ !side!\n", LISTING,
         {"ux1": -0.125, "uy1": 3.4, "roof": -12.5, "side": 4.75}),
        ("pif %\n%MODEL OUTPUTS:% w w w w !o!\n", LISTING, {"o": 8.394843}),
    ],
)  # fmt: skip
def test_they_read_what_pyemu_reads(tmp_path, instructions, output, expected):
    own, theirs = both(tmp_path, instructions, output)
    assert own == theirs == expected


@pytest.mark.parametrize(
    ("instructions", "output", "expected"),
    [
        ("pif *\nl1 *=* !sws! *%*\n", "SOIL WATER CONTENT (NO CORRECTION)=21.345634% wet\n",
         {"sws": "21.345634"}),
        ("pif %\nl1 t60 %=% !a3!\n",
         "TIME(1): A = 1.34564E-04, TIME(2): A = 1.45654E-04, TIME(3): A = 1.54982E-04\n",
         {"a3": "1.54982e-04"}),
        ("pif *\n*VECTOR*\nl1 (o1)4:5\n& (o2)11:12 !o3!\n", VECTORS,
         {"o1": "1.43253", "o2": "6.43235", "o3": "7.44532"}),
        ("pif $\nl1 [a]1:8 [b]9:16 [c]17:24\n", "1236.5678495.000-900.000\n",
         {"a": "1236.567", "b": "8495.000", "c": "-900.000"}),
        ("JIF ~\nL1 w !X!\n", "u 1.5D-03", {"x": "1.5d-03"}),
        ("pif ~\nl1 [a]1:3 t5\n", "1.5 m\n", {"a": "1.5"}),  # the last column is there
        ("pif ~\nl1 [a]3:3\n", "xy7z\n", {"a": "7"}),
        # a word ends at the mark that follows, or at a blank before it
        ("pif ~\nl1 !a!~m~ !b! ~m~\n", "1.5m 2.5 or so m\n", {"a": "1.5", "b": "2.5"}),
    ],
)  # fmt: skip
def test_what_the_manual_says_and_pyemu_does_not_do(tmp_path, instructions, output, expected):
    (tmp_path / "o.ins").write_text(instructions)
    lines, faults = read_instructions(str(tmp_path / "o.ins"))
    assert not faults
    assert observed(lines, output) == expected


def test_the_file_of_the_page_reads_its_listing(tmp_path):
    page = (Path(geoident.__file__).parent / "docs/how-to/pest.md").read_text(encoding="utf-8")
    listing, instructions = (
        next(part for part in page.split("```text\n") if part.startswith(begin)).split("```")[0]
        for begin in (" stage half", "pif ~")
    )
    output = listing.replace(" ...\n", listing.replace(" stage half\n", "").replace(" ...\n", ""))
    own, theirs = both(tmp_path, instructions, output)
    assert own == theirs
    assert own == {"side_1": 1.0412, "roof_1": 1.365, "side_2": 1.0412, "roof_2": 1.365}


@pytest.mark.parametrize(
    ("instructions", "said"),
    [
        ("l9 !a!", "line 2 of the instructions leads beyond its last line, 8"),
        ("~nowhere~ !a!", "from line 1 on no line has 'nowhere' (line 2 of the instructions)"),
        ("~roof~ ~nowhere~ !a!", "no line has 'roof' and then 'nowhere'"),
        ("l1 ~nowhere~ !a!", "line 1 has no 'nowhere' from column 1 on (line 2"),
        ("l1 [a]1:30 [b]25:28", "line 1 has nothing where 'b' is looked for"),
        ("l1 (a)8:8", "line 1 has nothing in the columns 8 to 8"),
        ("l1 [a]30:40", "line 1 has nothing where 'a' is looked for"),
        ("l1 (a)30:40", "line 1 has nothing in the columns 30 to 40"),
        ("l1 t30 !a!", "line 1 ends before column 30"),
        ("l1 w w w w !a!", "line 1 ends before the next word"),
        ("l1 w w !b! [a]1:5", "line 1 has been read up to column 12, and 'a' stands before"),
        ("l1 !dum! !dum! !dum! !dum! !a!", "line 1 has nothing where 'a' is looked for"),
    ],
)
def test_an_output_that_is_otherwise_is_said_to_be_so(tmp_path, instructions, said):
    (tmp_path / "o.ins").write_text(f"pif ~\n{instructions}\n")
    lines, faults = read_instructions(str(tmp_path / "o.ins"))
    assert not faults
    with pytest.raises(CannotFollow) as caught:
        observed(lines, LISTING)
    assert said in str(caught.value)


def test_all_that_is_wrong_in_a_file_is_said_with_its_place(tmp_path):
    text = "pif ~\n& !a!\n!b! w\nl1 !c! x3 ~open !d!\nl1 [e]9:3 !b! (f)3\nl0 !g!\nl1 ~~\n"
    (tmp_path / "o.ins").write_text(text)
    _, faults = read_instructions(str(tmp_path / "o.ins"))
    found = [(f.location.line, f.location.column, f.message) for f in faults]
    assert found == [
        (2, 1, "there is no line before that could go on"),
        (3, 1, "the line does not say which line of the output it is of"),
        (4, 11, "the text that begins here has no second '~'"),
        (5, 4, "column 9 does not come before 3"),
        (5, 11, "the observation 'b' is read in line 3 already"),
        (5, 15, "'(f)3' is not an instruction"),
        (6, 1, "'l0' is not an instruction"),
        (6, 1, "the line does not say which line of the output it is of"),
        (7, 4, "the text between the marks is empty"),
    ]


@pytest.mark.parametrize("text", ["", "ptf ~\nl1 !a!\n", "pif\nl1 !a!\n", "pif ~\nl1 w\n"])
def test_what_is_no_file_of_instructions_is_refused(tmp_path, text):
    (tmp_path / "o.ins").write_text(text)
    assert read_instructions(str(tmp_path / "o.ins"))[1]


LISTED = PROGRAM.partition("with open")[0] + (
    'with open("out.txt", "w") as out:\n'
    '    out.write("a listing\\n\\n stage half\\n gauge  value\\n")\n'
    "    for stage in STAGES:\n"
    '        out.write(f"\\n stage {stage}\\n gauge  value\\n")\n'
    "        for name in found:\n"
    '            out.write(f" {name:6}{1e3 * found[name][stage]:22.15e} mm\\n")\n'
)
INSTRUCTIONS = """\
pif ~
~a listing~
~stage half~
~stage half~
l2 [H_1]8:29
l1 (v_1)9:12
l1 ~D~ !d_1! ~mm~
~stage open~
l1
l1 w w !h_2!
l1 !dum! !v_2!
l1 ~D~ (d_2)9:29
"""
ENTRY = '{file: out.txt, instructions: out.ins, observation: "{gauge}_{number}", unit: mm}'
BY_COLUMN = '{file: out.csv, column: "{gauge}", row: {stage: "{stage}"}, unit: mm}'
MODEL = EXTERNAL.replace(BY_COLUMN, ENTRY)


def write(folder, instructions=INSTRUCTIONS, model=MODEL):
    case = write_case(folder, model, script=LISTED)
    (folder / "out.ins").write_text(instructions)
    return case


def test_a_fit_through_instructions_is_that_through_a_table(tmp_path):
    cases = write(tmp_path / "a"), write_case(tmp_path / "b")
    with trusted():
        found, own = (fit(plan_fit(Request(str(case))), Control()).result for case in cases)
    assert found.status == "converged"
    assert found.parameters.values == pytest.approx(own.parameters.values, rel=1e-6)
    assert found.counts.evaluations == own.counts.evaluations


def faults_of(case):
    with pytest.raises(InputError) as caught:
        read_case(str(case))
    return caught.value.faults


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("_{number}", "", "the instructions have no observation 'h', which is 'H' at 'half'"),
        ("{gauge}_{number}", "h_1", "the observation 'h_1' is 'H' at 'half' and 'H' at 'open'"),
        ("out.ins", "in.ins", "there is no file"),
        ("instructions: out.ins, ", "", "found file and observation; expected"),
        (
            "instructions: out.ins",
            "line: 3, word: 2",
            "found file, line, word and observation; expected",
        ),
    ],
)
def test_what_does_not_fit_the_case_is_said_there(tmp_path, old, new, said):
    case = write(tmp_path, model=MODEL.replace(old, new))
    [fault, *_] = [fault for fault in faults_of(case) if said in fault.message]
    assert (fault.location.file, fault.location.line > 0) == (str(case), True)


def test_all_readings_without_observation_are_named_and_faults_of_the_file_are_its_own(tmp_path):
    case = write(tmp_path, INSTRUCTIONS.replace("!d_1!", "!dum!").replace("!h_2!", "!dum!"))
    said = " ".join(fault.message for fault in faults_of(case))
    assert "'H' at 'open'" in said
    assert "'D' at 'half'" in said
    case = write(tmp_path, INSTRUCTIONS + "l1 what\n")
    [fault] = faults_of(case)
    assert (fault.location.file, fault.location.line) == (str(tmp_path / "out.ins"), 13)


def test_another_instruction_file_is_another_model(tmp_path):
    case = write(tmp_path)
    with trusted():
        request = Request(str(case), overrides=("fit.method=simplex",))
        before = plan_fit(request).identity
        (tmp_path / "out.ins").write_text(INSTRUCTIONS.replace("(v_1)9:12", "(v_1)9:14"))
        assert plan_fit(request).identity != before
