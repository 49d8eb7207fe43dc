"""Each fault of a case is found where it is written, and said in words that help."""

import pytest

HEADING = "  - {name: heading, excavate: [heading]}"
BENCH = "excavate: [bench], install: {lining: shotcrete}}"
EX1 = "  EX1: {kind: extensometer, head: [12.5, 3 m], anchors: {a5: [17.5, 3 m]}, accuracy: 0.1 mm}"
CV1 = "  CV1: {kind: convergence, between: [[-1, 0 m], [1, 0 m]], accuracy: 0.2 mm, zero: heading}"
E_ROCK = "{start: 15 GPa, bounds: [2 GPa, 80 GPa], scale: log}"
HEIM = "{model: heim, vertical: 8 MPa, K0: $K0}"
FIT = "fit: {method: gauss-newton, stages: [bench 1]}"

# name: (text of the sound case, what it is replaced by, path of the key, words of the message)
FAULTS = {
    # quantities
    "bare number": ("8 MPa", "«8", "in_situ.vertical", ["'8' has no unit", "'8 MPa' or '8 GPa'"]),
    "wrong dimension": (
        "8 MPa",
        "«8 m",
        "in_situ.vertical",
        ["a length; expected a pressure", "MPa"],
    ),
    "unknown unit": ("8 MPa", "«8 Mpas", "in_situ.vertical", ["no unit 'Mpas'", "mean 'MPa'?"]),
    "decimal comma": ("15 GPa", '«"1,5 GPa"', "parameters.E_rock.start", ["comma", "'1.5 GPa'"]),
    "nan": ("0.25", "«.nan", "materials.rock.nu", ["'.nan' is not a finite number"]),
    "inf": ("8 MPa", "«inf MPa", "in_situ.vertical", ["not a finite number"]),
    "last entry bare": ("[12.5, 3 m]", "[12.5 m, «3]", "gauges.EX1.head[1]", ["no unit"]),
    "tie where none may be": ("0.1 mm", "«$K0", "gauges.EX1.accuracy", ["cannot be used here"]),
    "malformed tie": ("$K0", "«$K0*2", "in_situ.K0", ["not a tie", "0.6 $E_rock"]),
    "name without $": (
        "$E_rock,",
        "«E_rock,",
        "materials.rock.E",
        ["not a number", "write $E_rock"],
    ),
    "more than a turn": (
        "nu: 0.25,",
        "nu: 0.25, yield: {type: mohr-coulomb, cohesion: 1 Pa, friction: 1°, dilation: «40 rad},",
        "materials.rock.yield.dilation",
        ["an angle of 2292 degrees", "Write '40 deg'"],
    ),
    "negative accuracy": ("0.1 mm", "«-0.1 mm", "gauges.EX1.accuracy", ["such as 0.1 mm"]),
    "accuracy of zero": ("0.1 mm", "«0 mm", "gauges.EX1.accuracy", ["must be positive"]),
    "more released than there is": (
        BENCH,
        "excavate: [bench], release: {bench: «1.2}, install: {lining: shotcrete}}",
        "stages[1].release.bench",
        ["not between 0", "such as 0.4"],
    ),
    "nothing held to release": (
        BENCH,
        "excavate: [bench], release: {«heading: 0.5}, install: {lining: shotcrete}}",
        "stages[1].release.heading",
        ["no stress of 'heading' is held"],
    ),
    # keys
    "unknown key": ("title:", "«titel:", "titel", ["'titel' is not known", "mean 'title'?"]),
    "unknown inner key": (
        "density: 2650",
        "«densty: 2650",
        "materials.rock.densty",
        ["Did you mean 'density'?"],
    ),
    "unknown key in a variant": (
        "between:",
        "between: [[-1, 0 m], [1, 0 m]], «betwen:",
        "gauges.CV1.betwen",
        ["Did you mean 'between'?"],
    ),
    "comma cut a number": (
        "accuracy: 0.1 mm",
        "accuracy: 0, «1 mm",
        "gauges.EX1.1 mm",
        ["a comma separates '1 mm'", "Write 'accuracy: 0.1 mm' with a decimal point"],
    ),
    "comma after a unit": ("accuracy: 0.1 mm", "accuracy: 0 mm, «1 mm", "gauges.EX1.1 mm", None),
    "no bounds": (E_ROCK, "{start: 15 GPa}", "parameters.E_rock", ["bounds", "are required"]),
    "no mesh": ("mesh: {file: cavern.msh}\n", "", "", ["there is no mesh"]),
    "other format": ("case/1", "case/9", "format", ["found 'geoident-case/9'", "geoident-case/1"]),
    "unknown analysis": ("plane-strain", "«plane-stress", "analysis", ["mean 'plane-strain'?"]),
    "unknown gauge kind": (
        "kind: convergence",
        "kind: «convergense",
        "gauges.CV1.kind",
        ["Did you mean 'convergence'?"],
    ),
    "no gauge kind": ("kind: convergence, ", "", "gauges.CV1", ["'kind' is missing"]),
    "gauge that is no mapping": (CV1, "  CV1: «7", "gauges.CV1", ["a mapping"]),
    "list for a text": ("Cavern", "«[a]", "title", ["found a list", "expected a text"]),
    "text for a list": ("excavate: [bench]", "excavate: «bench", "stages[1].excavate", ["a list"]),
    "nothing for a mapping": (HEIM, "«7", "in_situ", ["found '7'; expected a mapping"]),
    "bad flag": (
        HEIM,
        "{model: heim, vertical: 1 Pa, K0: $K0, held: «yes}",
        "in_situ.held",
        ["true"],
    ),
    "bad parameter name": ("E_rock: {", "«E-rock: {", "parameters.E-rock", None),
    # parameters
    "bounds reversed": (
        "[2 GPa, 80 GPa]",
        "«[80 GPa, 2 GPa]",
        "parameters.E_rock.bounds",
        ["'80 GPa' is not below", "Write [2 GPa, 80 GPa]"],
    ),
    "one bound": (
        "[2 GPa, 80 GPa]",
        "«[2 GPa]",
        "parameters.E_rock.bounds",
        ["found 1 entry; expected 2"],
    ),
    "bounds with decimal commas": (
        "[2 GPa, 80 GPa]",
        "«[2,5 GPa, 80 GPa]",
        "parameters.E_rock.bounds",
        ["3 entries", "decimal comma", "[2.5 GPa, 80 GPa]"],
    ),
    "bounds as a range": (
        "[2 GPa, 80 GPa]",
        "«[2 GPa .. 80 GPa]",
        "parameters.E_rock.bounds",
        ["Write [2 GPa, 80 GPa]"],
    ),
    "start outside": ("15 GPa", "«1 GPa", "parameters.E_rock.start", ["outside the bounds"]),
    "log of zero": ("[2 GPa", "«[0 GPa", "parameters.E_rock.bounds", ["log needs positive"]),
    "bound of other dimension": (
        "80 GPa]",
        "«80 m]",
        "parameters.E_rock.bounds[1]",
        ["'80 m' is a length", "a pressure"],
    ),
    "prior sd": (
        "scale: log}",
        "prior: {mean: 9 GPa, sd: «0 GPa}}",
        "parameters.E_rock.prior.sd",
        ["not positive"],
    ),
    "lognormal prior below zero": (
        "scale: log}",
        "prior: {mean: «-9 GPa, sd: 1 GPa, kind: lognormal}}",
        "parameters.E_rock.prior.mean",
        ["positive mean"],
    ),
    "unknown parameter": ("$E_rock", "$E_rok", "materials.rock.E", None),
    "unused parameter": ("K0: $K0", "K0: 1", "parameters.K0", ["nothing depends on it", "$K0"]),
    "tie of other dimension": (
        "vertical: 8 MPa",
        "vertical: «$K0",
        "in_situ.vertical",
        ["pressure"],
    ),
    "tied nu inadmissible": ("nu: 0.25", "nu: «$K0", "materials.rock.nu", ["is 1 at the start"]),
    # materials
    "nu": ("0.25", "«0.5", "materials.rock.nu", ["between -1 and 0.5"]),
    "E": ("$E_rock,", "«-1 GPa,", "materials.rock.E", None),
    "G": ("6 GPa", "«0 GPa", "materials.shotcrete.G", ["must be positive"]),
    "mixed pair": (", K: 8", ", E: 8", "materials.shotcrete", ["found E and G", "K and G"]),
    "negative density": ("2650", "«-2650", "materials.rock.density", ["negative"]),
    "unknown material": ("bench: rock", "bench: «rok", "groups.bench", ["mean 'rock'?"]),
    "unknown installed material": (
        "lining: shotcrete",
        "lining: «shotcret",
        "stages[1].install.lining",
        ["Did you mean 'shotcrete'?"],
    ),
    # in situ, gravity, loads, supports
    "tension": ("8 MPa", "«-8 MPa", "in_situ.vertical", ["a tension", "Write '8 MPa'"]),
    "tension by a tie": (
        "vertical: 8 MPa",
        "vertical: «-1e-3 $E_rock",
        "in_situ.vertical",
        ["can only be a tension", "bounds of 'E_rock'"],
    ),
    "heim by nothing": ("vertical: 8 MPa, ", "", "in_situ", ["found neither", "unit_weight"]),
    "shear out of plane": (
        HEIM,
        "{model: constant, xx: 1 Pa, yy: 1 Pa, zz: 1 MPa, «yz: 2 Pa}",
        "in_situ.yz",
        None,
    ),
    "gravity of three": (
        "9.81 m/s2",
        "«[0, 0, 9 m/s2]",
        "gravity",
        ["found 3; expected 2 components"],
    ),
    "negative gravity": ("9.81 m/s2", "«-9.81 m/s2", "gravity", ["negative", "downwards"]),
    "two kinds of load": (
        "pressure: 1 MPa",
        "pressure: 1 MPa, traction: [1, 1 Pa]",
        "loads.water",
        ["found pressure and traction"],
    ),
    "traction of one": (
        "pressure: 1 MPa",
        "traction: «[1 MPa]",
        "loads.water.traction",
        ["found 1; expected 2"],
    ),
    "support along z": ("left: x,", "left: «z,", "supports.left", ["no direction z"]),
    # stages
    "reserved stage": ("name: heading", "name: «virgin", "stages[0].name", None),
    "stage twice": ("name: bench 1", "name: «heading", "stages[1].name", None),
    "unknown group": ("[bench]", "[«bnch]", "stages[1].excavate[0]", ["mean 'bench'?"]),
    "absent group": ("[bench]", "[«lining]", "stages[1].excavate[0]", ["not present"]),
    "excavated twice": (
        "[bench]",
        "[bench, «heading]",
        "stages[1].excavate[1]",
        ["since 'heading' excavated it"],
    ),
    "installed twice": (
        BENCH,
        BENCH + "\n  - {name: more, install: {«lining: shotcrete}}",
        "stages[2].install.lining",
        ["already made of 'shotcrete'"],
    ),
    "changed where absent": (
        BENCH,
        "change: {«lining: shotcrete}}",
        "stages[1].change.lining",
        ["cannot be changed"],
    ),
    "installed and changed": (
        "install: {lining: shotcrete}}",
        "install: {lining: shotcrete}, change: {«lining: rock}}",
        "stages[1].change.lining",
        ["installed and changed"],
    ),
    "load that does not act": (
        "install: {lining: shotcrete}}",
        "install: {lining: shotcrete}, remove: [«watr]}",
        "stages[1].remove[0]",
        ["no load 'watr'", "mean 'water'?"],
    ),
    # gauges
    "three coordinates": (
        "[17.5, 3 m]",
        "«[17.5, 3, 0 m]",
        "gauges.EX1.anchors.a5",
        ["found 3; expected 2 components (x, y)"],
    ),
    "zero length": (
        "[17.5, 3 m]",
        "«[12.5, 3 m]",
        "gauges.EX1.anchors.a5",
        ["the two points coincide"],
    ),
    "unknown zero": ("zero: heading", "zero: «headin", "gauges.CV1.zero", ["mean 'heading'?"]),
    "no direction": (
        EX1,
        "  EX1: {kind: displacement, point: [0, 0 m], accuracy: 1 mm}",
        "gauges.EX1",
        ["found neither", "component, or direction"],
    ),
    "direction of zero": (
        EX1,
        "  EX1: {kind: displacement, point: [0, 0 m], direction: «[0, 0], accuracy: 1 mm}",
        "gauges.EX1.direction",
        ["length zero"],
    ),
    "along z in the plane": (
        CV1,
        "  CV1: {kind: displacement, point: [0, 0 m], component: «z, accuracy: 1 mm}",
        "gauges.CV1.component",
        ["no displacement along z"],
    ),
    # fit
    "unknown method": (
        "gauss-newton",
        "«gaus-newton",
        "fit.method",
        ["no method 'gaus-newton'", "simplex", "Did you mean 'gauss-newton'?"],
    ),
    "unknown fit stage": ("[bench 1]}", "[«bench1]}", "fit.stages[0]", ["mean 'bench 1'?"]),
    "bad count": (
        FIT,
        "fit: {simplex: {restarts: «1.5}}",
        "fit.simplex.restarts",
        ["whole number"],
    ),
    "bad option": (FIT, "fit: {simplex: {«alfa: 1}}", "fit.simplex.alfa", ["mean 'alpha'?"]),
    "option range": (FIT, "fit: {simplex: {beta: «2}}", "fit.simplex.beta", ["between 0 and 1"]),
    "grid of unknown": (
        FIT,
        "fit: {scan: {grid: {«E_rok: {from: 1 GPa, to: 2 GPa}}}}",
        "fit.scan.grid.E_rok",
        ["Did you mean 'E_rock'?"],
    ),
    "grid of other dimension": (
        FIT,
        "fit: {scan: {grid: {K0: {from: «1 GPa, to: 2}}}}",
        "fit.scan.grid.K0.from",
        ["a number without unit"],
    ),
    # files
    "missing mesh": ("cavern.msh", "«caver.msh", "mesh.file", ["Did you mean 'cavern.msh'?"]),
    "missing readings": ("readings.csv", "«reading.csv", "readings", ["mean 'readings.csv'?"]),
    "path that is none": ("cavern.msh", '«"a\\nb"', "mesh.file", ["there is no file"]),
}


@pytest.mark.parametrize("name", [name for name, row in FAULTS.items() if row[3] is not None])
def test_fault_is_said_at_its_place(name, project, changed):
    old, new, path, words = FAULTS[name]
    fault = project.only_fault(changed(old, new))
    assert fault.path == path
    for word in words:
        assert word in f"{fault.message} {fault.hint}"


@pytest.mark.parametrize("name", [name for name, row in FAULTS.items() if row[3] is None])
def test_fault_is_said_beside_its_consequences(name, project, changed):
    old, new, path, _ = FAULTS[name]
    faults = project.faults(changed(old, new).replace("«", ""))
    assert path in [fault.path for fault in faults]


def test_all_faults_of_the_sections_are_said_at_once(project, changed):
    text = changed("8 MPa", "8").replace("0.25", "0.7").replace("title", "titel")
    text = text.replace("[2 GPa, 80 GPa]", "[80 GPa, 2 GPa]").replace("0.1 mm", "0.1 kg/m3")
    paths = [fault.path for fault in project.faults(text)]
    assert paths == [
        "titel",
        "parameters.E_rock.bounds",
        "materials.rock.nu",
        "in_situ.vertical",
        "gauges.EX1.accuracy",
    ]


def test_wrong_words_are_said_beside_all_else_in_valid_sections(project, changed):
    """The analysis, the model of a stress, the scale of a parameter."""
    text = changed("plane-strain", "2D").replace("scale: log", "scale: logarithmic")
    text = text.replace("[2 GPa, 80 GPa]", "[80 GPa, 2 GPa]").replace("zero: heading", "zero: 2")
    text = text.replace("model: heim, vertical: 8 MPa", "model: Heim, sigma_v: 8 MPa")
    faults = project.faults(text)
    assert [(fault.path, fault.hint.rpartition(" ")[2]) for fault in faults] == [
        ("analysis", "'plane-strain'?"),
        ("parameters.E_rock.bounds", "GPa]."),
        ("parameters.E_rock.scale", "'log'?"),
        ("in_situ.model", "'heim'?"),
        ("gauges.CV1.zero", "1."),
    ]
    (hidden,) = project.faults(
        changed("model: heim, vertical: 8 MPa", "model: heim, sigma_v: 8 MPa")
    )[:1]
    assert (hidden.path, hidden.hint) == ("in_situ.sigma_v", "Did you mean 'vertical'?")


def test_all_broken_references_are_said_at_once_with_those_of_the_readings(project, changed):
    text = changed("zero: heading", "zero: nowhere").replace("bench: rock", "bench: marble")
    (project.folder / "readings.csv").write_text("gauge,stage,value,unit\nEX1,heading,1,mm\n")
    faults = project.faults(text.replace("[bench 1]", "[bench 9]"))
    assert [fault.code for fault in faults] == [
        "unknown-material",
        "unknown-stage",
        "unknown-stage",
        "unknown-gauge",
    ]


def test_the_missing_key_of_the_case_itself_is_at_its_beginning(project, changed):
    (fault,) = project.faults(changed("analysis: plane-strain\n", ""))
    assert (fault.location.line, fault.location.column, fault.path) == (1, 1, "")
    assert "'analysis' is missing" in fault.message


def test_many_faults_are_cut_with_their_number(project, changed):
    stages = "".join(f"  - {{name: s{n}, excavate: [x{n}]}}\n" for n in range(150))
    faults = project.faults(changed("gauges:\n", f"{stages}gauges:\n"))
    assert len(faults) == 101
    assert faults[-1].message == "and 50 more faults"


def test_a_fault_reads_as_file_line_column_path_found_expected_remedy(project, changed):
    (fault,) = project.faults(changed("8 MPa", "8"))
    assert str(fault) == (
        f"{project.file}:13:34: in_situ.vertical: '8' has no unit; expected a pressure\n"
        "    Write '8 kPa' or '8 MPa' or '8 GPa', or another of Pa, kPa, MPa, GPa, bar, kbar, "
        "N/m2, kN/m2, MN/m2, N/mm2, kN/mm2, kgf/cm2, psi, ksi, psf, ksf, tsf and 10 more."
    )


PARTLY = "excavate: [bench], release: {bench: 0.4}}"
LINED = "  - {name: lined, install: {bench: shotcrete}"
REST = "  - {name: more, release: {bench: 60 %}}\n  - {name: rest, release: {bench: 1}}"


@pytest.mark.parametrize(
    "stages",
    [
        f"{PARTLY}\n{LINED}, release: {{bench: 1}}}}",
        f"{PARTLY}\n{LINED}, release: {{bench: $K0}}}}",
        f"{PARTLY}\n{LINED}}}\n{REST}",
        f"{PARTLY}\n{REST}\n{LINED}}}",
        f"{PARTLY}\n{LINED}, independent: true}}\n  - {{base: lined, {REST[5:]}",
    ],
)
def test_ground_that_is_released_in_parts_can_be_lined(stages, project, changed):
    project.read(changed(BENCH, stages))


@pytest.mark.parametrize(
    "stages",
    [
        f"{PARTLY}\n{LINED}}}",
        f"{PARTLY.replace('0.4', '$K0')}\n{LINED}}}",
        f"{PARTLY}\n{LINED}}}\n  - {{name: out, excavate: [bench], release: {{bench: 1}}}}",
        f"{PARTLY}\n{LINED}, independent: true}}\n{REST}",  # of another line of stages
    ],
)
def test_ground_that_stays_partly_held_is_not_filled_again(stages, project, changed):
    (fault,) = project.faults(changed(BENCH, stages))
    assert (fault.code, fault.path) == ("still-held", "stages[2].install.bench")
