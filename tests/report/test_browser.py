"""The page in a real browser: nothing to complain of, nothing asked for, every figure to be seen.

Needs chromium, and pdftoppm to look at printed pages: ``apt-get install -y chromium
poppler-utils``, then ``pytest tests/report/test_browser.py``.
"""

import io
import itertools
import json
import re
import shutil
import subprocess
from html import unescape
from pathlib import Path

import numpy as np
import pytest
from matplotlib.image import imread

import geoident
from geoident.report.page.page import report_page
from geoident.workflow.report import read_results

CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))),
                None)  # fmt: skip
pytestmark = pytest.mark.skipif(
    CHROMIUM is None or shutil.which("pdftoppm") is None,
    reason="needs chromium and pdftoppm: apt-get install -y chromium poppler-utils, and run again",
)
WIDTH = 1200
FULL = 0.5
"""Part of their height that printed pages but the last are filled to, in the mean."""
PAPER_WIDTH, PAPER_HEIGHT = 510.2, 637.8
"""What a sheet has for a figure, points: 180 mm by 225 mm."""

LEAST_PRINTED = 5.5
"""Smallest letters of figures that can be read on paper, points."""

CASES = Path(__file__).parents[2] / "cases"
FLAGS = (
    "--headless", "--no-sandbox", "--disable-gpu", "--disable-quic", "--no-first-run",
    "--disable-background-networking", "--disable-component-update", "--disable-sync",
    "--disable-features=NetworkTimeServiceQuerying,OptimizationHints,MediaRouter",
    "--disable-extensions", "--hide-scrollbars", "--force-device-scale-factor=1",
    "--host-resolver-rules=MAP * ~NOTFOUND",
)  # fmt: skip
MEASURE = """<script>
addEventListener("load", () => {
  const rectangle = e => { const r = e.getBoundingClientRect();
    return {name: e.closest("figure").id, x: r.x, y: r.y, width: r.width, height: r.height,
            images: [...e.querySelectorAll("image")].map(i => i.getBoundingClientRect().width)}; };
  const pre = document.createElement("pre");
  pre.id = "measured";
  pre.textContent = JSON.stringify({
    width: document.documentElement.scrollWidth, height: document.documentElement.scrollHeight,
    figures: [...document.querySelectorAll("figure svg")].map(rectangle),
    bold: getComputedStyle(document.querySelector("figcaption b")).fontWeight,
    main: getComputedStyle(document.querySelector("main")).minWidth});
  document.body.append(pre);
});
</script></head>"""


def chromium(folder, *flags):
    """Runs the browser with a profile of its own; what it says on stderr."""
    done = subprocess.run(
        [CHROMIUM, *FLAGS, f"--user-data-dir={folder / 'profile'}", *flags],
        capture_output=True, text=True, timeout=120, check=True,
    )  # fmt: skip
    return done.stdout, done.stderr


@pytest.fixture(
    scope="module", params=["plane_page", pytest.param("whole_solid_page", marks=pytest.mark.slow)]
)
def seen(request, tmp_path_factory):
    """What the browser makes of a page: its size, the figures' places, its pixels, its log."""
    folder = tmp_path_factory.mktemp(request.param)
    text = request.getfixturevalue(request.param)
    file, probe = folder / "page.html", folder / "probe.html"
    file.write_text(text, encoding="utf-8")
    # The measuring copy runs a script, so it goes without the policy; all else is the page itself.
    open_text = re.sub(r'<meta http-equiv="Content-Security-Policy"[^>]*>', "", text, count=1)
    probe.write_text(open_text.replace("</head>", MEASURE, 1), encoding="utf-8")
    dom, _ = chromium(folder, f"--window-size={WIDTH},1000", "--dump-dom", probe.as_uri())
    measured = json.loads(re.search(r'<pre id="measured">(.*?)</pre>', dom, re.DOTALL)[1])
    _, log = chromium(
        folder,
        f"--window-size={WIDTH},{measured['height']}",
        "--enable-logging=stderr", f"--log-net-log={folder / 'net.json'}",
        f"--screenshot={folder / 'page.png'}", file.as_uri(),
    )  # fmt: skip
    net = json.loads((folder / "net.json").read_text())
    return measured, imread(folder / "page.png")[..., :3], log, net


def test_the_console_is_silent(seen):
    assert "CONSOLE" not in seen[2]


@pytest.mark.slow  # looks at the tests themselves, as the two others that would be seen
def test_a_violation_would_be_seen(tmp_path, plane_page):
    bad = plane_page.replace("<main>", '<main><p style="color: red">x</p><script>1</script>', 1)
    (tmp_path / "bad.html").write_text(bad, encoding="utf-8")
    _, log = chromium(
        tmp_path, "--enable-logging=stderr", f"--screenshot={tmp_path / 'bad.png'}",
        (tmp_path / "bad.html").as_uri(),
    )  # fmt: skip
    assert "CONSOLE" in log
    assert "Content Security Policy" in log


def asked_for(net):
    """Addresses outside this machine that the page asked for; the browser's own have no origin."""
    kinds = {number: name for name, number in net["constants"]["logEventTypes"].items()}
    asked = {
        event["params"]["url"]
        for event in net["events"]
        if kinds[event["type"]] == "URL_REQUEST_START_JOB"
        and "url" in event.get("params", {})
        and event["params"]["initiator"] != "not an origin"
    }
    return {url for url in asked if not url.startswith(("file:", "data:", "chrome"))}


def test_nothing_is_asked_for_from_outside(seen):
    assert not asked_for(seen[3])


@pytest.mark.slow
def test_a_request_would_be_seen(tmp_path):
    page = "<!DOCTYPE html><title>x</title><img src='http://outside.example/x.png' alt=''>"
    (tmp_path / "page.html").write_text(page)
    net = tmp_path / "net.json"
    chromium(
        tmp_path,
        f"--log-net-log={net}",
        f"--screenshot={tmp_path / 'page.png'}",
        (tmp_path / "page.html").as_uri(),
    )
    assert asked_for(json.loads(net.read_text())) == {"http://outside.example/x.png"}


def test_the_style_of_the_page_counts(seen):
    assert seen[0]["bold"] == "700"
    assert seen[0]["main"] == "0px"  # else its tables would push the page sideways


def test_no_part_is_wider_than_the_window(seen):
    assert seen[0]["width"] <= WIDTH


def test_every_figure_is_seen(seen):
    measured, pixels, _, _ = seen
    assert pixels.shape[:2] == (measured["height"], WIDTH)
    for place in measured["figures"]:
        x, y, width, height = (round(place[key]) for key in ("x", "y", "width", "height"))
        assert width > 250, place["name"]
        assert height > 80, place["name"]
        part = pixels[y : y + height, x : x + width]
        ink = (part < 0.9).any(axis=2)
        assert ink.mean() > 0.004, f"{place['name']} is blank"
        rows = np.flatnonzero(ink.any(axis=1))
        columns = np.flatnonzero(ink.any(axis=0))
        assert np.ptp(rows) > 0.5 * height, place["name"]
        assert np.ptp(columns) > 0.4 * width, place["name"]
        assert all(image > 0 for image in place["images"]), place["name"]


def test_no_figure_lies_on_another(seen):
    for one, other in itertools.combinations(seen[0]["figures"], 2):
        apart = (
            one[start] + one[size] <= other[start] or other[start] + other[size] <= one[start]
            for start, size in (("x", "width"), ("y", "height"))
        )
        assert any(apart), (one["name"], other["name"])


@pytest.mark.parametrize("name", ["residuals", "correlation"])
def test_letters_and_lines_stand_where_matplotlib_puts_them(seen, name, request):
    measured, pixels, _, _ = seen
    (place,) = [each for each in measured["figures"] if each["name"] == f"figure-{name}"]
    x, y, width, height = (round(place[key]) for key in ("x", "y", "width", "height"))
    plane = "figure-yielded" in {f["name"] for f in measured["figures"]}
    file = io.BytesIO()
    drawn = request.getfixturevalue("figures" if plane else "whole_solid")
    figure = drawn["plane"][name] if plane else drawn[1][name]
    figure.savefig(file, format="png", dpi=width / figure.get_figwidth())
    own = imread(io.BytesIO(file.getvalue()))[..., :3]
    shown = pixels[y : y + height, x : x + width]
    size = [min(pair) // 8 for pair in zip(own.shape[:2], shown.shape[:2], strict=True)]
    assert abs(own.shape[1] - shown.shape[1]) <= 1, "the figure has its own proportions"
    there = _coarse(shown, size)
    shifted = (
        np.roll(own, shift, axis=(0, 1)) for shift in itertools.product((-1, 0, 1), repeat=2)
    )
    likeness = [np.corrcoef(_coarse(picture, size), there)[0, 1] for picture in shifted]
    assert max(likeness) > 0.95


WIDTHS = (1600, 1000, 420)
LOOK = """<script>
addEventListener("load", () => {
  const box = e => { const r = e.getBoundingClientRect();
    return [r.x, r.y, r.x + r.width, r.y + r.height]; };
  const straight = e => { const m = e.getScreenCTM();
    return Math.abs(m.b) < 1e-6 || Math.abs(m.a) < 1e-6; };
  const words = svg => [...svg.querySelectorAll("text")].filter(e => e.textContent.trim());
  const own = e => e.closest(".drawing, .wide, nav");
  const beyond = e => !own(e) && e.getBoundingClientRect().right > innerWidth + 1;
  parent.postMessage(JSON.stringify({
    width: innerWidth, scroll: document.documentElement.scrollWidth,
    beyond: [...document.querySelectorAll("body *")].filter(beyond)
      .map(e => e.outerHTML.slice(0, 80)),
    figures: [...document.querySelectorAll("figure")].map(f => ({name: f.id,
      box: box(f.querySelector("svg")), letters: Math.min(...words(f.querySelector("svg"))
        .map(e => e.getBoundingClientRect().height)),
      words: words(f.querySelector("svg")).map(e =>
        ({text: e.textContent.trim(), straight: straight(e), box: box(e)}))}))}), "*");
});
</script></head>"""
FRAMES = """<!DOCTYPE html><title>frames</title><pre id="looks"></pre><script>
addEventListener("message", event => {
  document.getElementById("looks").textContent += event.data + "\\n"; });
</script>"""


def looks(folder, text):
    """What the browser makes of a page at each of some widths, by the width."""
    open_text = re.sub(r'<meta http-equiv="Content-Security-Policy"[^>]*>', "", text, count=1)
    (folder / "framed.html").write_text(open_text.replace("</head>", LOOK, 1), encoding="utf-8")
    # A window has a least width of its own, a frame has not.
    frames = "".join(
        f'<iframe src="framed.html" width="{width}" height="900" style="border:0"></iframe>'
        for width in WIDTHS
    )
    (folder / "frames.html").write_text(FRAMES + frames, encoding="utf-8")
    dom, _ = chromium(
        folder, "--window-size=1700,1000", "--virtual-time-budget=9000", "--dump-dom",
        (folder / "frames.html").as_uri(),
    )  # fmt: skip
    found = re.search(r'<pre id="looks">(.*?)</pre>', dom, re.DOTALL)[1]
    each = [json.loads(unescape(line)) for line in found.splitlines() if line]
    assert {look["width"] for look in each} == set(WIDTHS)
    return {look["width"]: look for look in each}


def pages_printed(folder, text):
    """A page on paper: its words, and of each sheet the part of its height that is filled."""
    (folder / "printed.html").write_text(text, encoding="utf-8")
    file = folder / "printed.pdf"
    chromium(folder, f"--print-to-pdf={file}", "--no-pdf-header-footer",
             (folder / "printed.html").as_uri())  # fmt: skip
    subprocess.run(["pdftoppm", "-r", "36", "-png", file, folder / "sheet"], check=True)
    found = []
    for sheet in sorted(folder.glob("sheet-*.png")):
        pixels = imread(sheet)[..., :3]
        rows = np.flatnonzero((pixels[:, : int(0.85 * pixels.shape[1])] < 0.9).any(axis=(1, 2)))
        top, bottom = (round(part * len(pixels) / 297) for part in (17, 297 - 16))  # margins, mm
        inside = rows[(rows >= top) & (rows < bottom)]
        found.append((inside.max(initial=top) - top) / (bottom - top))
        sheet.unlink()
    words = subprocess.run(["pdftotext", "-layout", file, "-"], capture_output=True, text=True,
                           check=True).stdout  # fmt: skip
    return words, found


def printed_letters(text):
    """Of each figure of a page the size of its smallest letters on paper, points."""
    sizes = {}
    for name, width, height, svg in re.findall(
        r'<figure id="([^"]+)".*?<svg width="([0-9.]+)pt" height="([0-9.]+)pt"(.*?)</svg>', text,
        re.DOTALL,
    ):  # fmt: skip
        letters = re.findall(r"font(?:-size)?: ([0-9.]+)px", svg)
        shrunk = min(1.0, PAPER_WIDTH / float(width), PAPER_HEIGHT / float(height))
        sizes[name] = shrunk * min(map(float, letters), default=np.inf)
    return sizes


def cut(look):
    """Words of figures that stand beyond the edge of their figure."""
    return [
        (figure["name"], word["text"])
        for figure in look["figures"]
        for word in figure["words"]
        if word["box"][0] < figure["box"][0] - 1
        or word["box"][1] < figure["box"][1] - 1
        or word["box"][2] > figure["box"][2] + 1
        or word["box"][3] > figure["box"][3] + 1
    ]


def overlapping(look):
    """Pairs of words that lie on each other; a box is higher than its letters by a third."""
    pairs = []
    for figure in look["figures"]:
        words = [word for word in figure["words"] if word["straight"]]
        for one, other in itertools.combinations(words, 2):
            a, b = one["box"], other["box"]
            wide = min(a[2], b[2]) - max(a[0], b[0])
            high = min(a[3], b[3]) - max(a[1], b[1])
            if wide > 2 and high > 0.3 * min(a[3] - a[1], b[3] - b[1]):
                pairs.append((figure["name"], one["text"], other["text"]))
    return pairs


def assert_sound_in_widths(folder, text):
    """Nothing is cut, overlaps or pushes the page sideways."""
    for width, look in looks(folder, text).items():
        assert look["scroll"] <= width, width
        assert look["beyond"] == [], width
        assert cut(look) == [], width
        assert overlapping(look) == [], width
        assert min(figure["letters"] for figure in look["figures"]) > 7, width


def assert_sound(folder, text):
    """It is sound in all widths, complete on paper, and paper is not wasted."""
    assert_sound_in_widths(folder, text)
    words, filled = pages_printed(folder, text)
    for number in re.findall(r"<figcaption><b>(Figure \d+:)|<caption>(Table \d+:)", text):
        assert "".join(number) in words
    for case in re.findall(r"<pre>(.*?)</pre>", text, re.DOTALL):
        for line in unescape(case).splitlines():
            assert " ".join(line.split()) in " ".join(words.split())  # the file to its end
    assert min(printed_letters(text).values()) >= LEAST_PRINTED, printed_letters(text)
    assert np.mean(filled[:-1] or [1.0]) > FULL, filled


def test_the_page_is_sound_in_three_widths(plane_page, tmp_path):
    assert_sound_in_widths(tmp_path, plane_page)


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["plane_page", "whole_solid_page"])
def test_the_page_is_sound_in_three_widths_and_on_paper(kind, request, tmp_path):
    assert_sound(tmp_path, request.getfixturevalue(kind))


@pytest.mark.slow
def test_faults_of_a_page_would_be_seen(tmp_path):
    words = '<text x="{}" y="50" font-size="20">a long label</text>'
    figure = (
        '<figure id="f"><svg width="300" height="100" viewBox="0 0 300 100">'
        + words.format(10) + words.format(40) + words.format(290) + "</svg></figure>"
    )  # fmt: skip
    wide = '<p class="x"><img alt="" width="1900" height="5"></p>'
    text = f"<!DOCTYPE html><html><head></head><body>{figure}{wide}</body></html>"
    look = looks(tmp_path, text)[1000]
    assert cut(look) == [("f", "a long label")]
    assert overlapping(look) == [("f", "a long label", "a long label")]
    assert look["scroll"] > 1000
    assert any("<img" in tag for tag in look["beyond"])


SHIPPED = ("cavern", "dam", "gravity-dam", "shaft", "braced-pit", "pressure-tunnel",
           "stratified-tunnel")  # fmt: skip
TEMPLATES = ("opening", "twin-tunnels", "tunnel")


@pytest.mark.slow
@pytest.mark.parametrize("name", [*SHIPPED, *TEMPLATES])
def test_pages_of_shipped_cases_are_sound(name, tmp_path):
    if name in SHIPPED:
        shutil.copytree(CASES / name, tmp_path, dirs_exist_ok=True)
    else:
        geoident.init(tmp_path, name, force=True)
    geoident.fit(tmp_path / "case.yaml")
    results = read_results([str(tmp_path / "case.fit.h5")])
    text = report_page(results)
    assert_sound(tmp_path, text)


@pytest.mark.slow
def test_a_comparison_stays_short(plane, tmp_path):
    text = report_page([(f"run-{k}", plane) for k in range(8)])
    assert_sound(tmp_path, text)


def _coarse(picture, size):
    """Means of darkness over 8 by 8 pixels."""
    rows, columns = size
    dark = 1 - picture[: 8 * rows, : 8 * columns].mean(axis=2)
    return dark.reshape(rows, 8, columns, 8).mean(axis=(1, 3)).ravel()
