"""The page in a real browser: nothing to complain of, nothing asked for, every figure to be seen.

Needs chromium: ``apt-get install -y chromium``, then ``pytest tests/report/test_browser.py``.
"""

import io
import itertools
import json
import re
import shutil
import subprocess

import numpy as np
import pytest
from matplotlib.image import imread

CHROMIUM = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))),
                None)  # fmt: skip
pytestmark = pytest.mark.skipif(
    CHROMIUM is None, reason="needs chromium: apt-get install -y chromium, and run again"
)
WIDTH = 1200
ERRANDS = re.compile(
    r"https?://(update\.googleapis\.com/service/update2|clients2\.google\.com/time"
    r"|accounts\.google\.com/ListAccounts)"
)
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
    main: getComputedStyle(document.querySelector("main")).maxWidth});
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


@pytest.fixture(scope="module", params=["plane", pytest.param("solid", marks=pytest.mark.slow)])
def seen(request, tmp_path_factory):
    """What the browser makes of a page: its size, the figures' places, its pixels, its log."""
    folder = tmp_path_factory.mktemp(request.param)
    text = request.getfixturevalue(f"{request.param}_page")
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
    """Addresses outside this machine that were asked for, without the browser's own errands."""
    kinds = {number: name for name, number in net["constants"]["logEventTypes"].items()}
    asked = {
        event["params"]["url"]
        for event in net["events"]
        if kinds[event["type"]] == "URL_REQUEST_START_JOB" and "url" in event.get("params", {})
    }
    return {
        url
        for url in asked
        if not (url.startswith(("file:", "data:", "chrome")) or ERRANDS.match(url))
    }


def test_nothing_is_asked_for_from_outside(seen):
    assert not asked_for(seen[3])


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
    assert seen[0]["main"] == "1040px"


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
    figures = sorted(seen[0]["figures"], key=lambda place: place["y"])
    for upper, lower in itertools.pairwise(figures):
        assert upper["y"] + upper["height"] <= lower["y"]


@pytest.mark.parametrize("name", ["residuals", "history", "correlation"])
def test_letters_and_lines_stand_where_matplotlib_puts_them(seen, name, figures):
    measured, pixels, _, _ = seen
    (place,) = [each for each in measured["figures"] if each["name"] == f"figure-{name}"]
    x, y, width, height = (round(place[key]) for key in ("x", "y", "width", "height"))
    kind = "plane" if "figure-yielded" in {f["name"] for f in measured["figures"]} else "solid"
    file = io.BytesIO()
    figures[kind][name].savefig(file, format="png", dpi=96)  # CSS has 96 pixels to the inch
    own = imread(io.BytesIO(file.getvalue()))[..., :3]
    shown = pixels[y : y + height, x : x + width]
    size = [min(pair) // 8 for pair in zip(own.shape[:2], shown.shape[:2], strict=True)]
    assert abs(own.shape[1] - shown.shape[1]) <= 1, "the figure is drawn in its own size"
    there = _coarse(shown, size)
    shifted = (
        np.roll(own, shift, axis=(0, 1)) for shift in itertools.product((-1, 0, 1), repeat=2)
    )
    likeness = [np.corrcoef(_coarse(picture, size), there)[0, 1] for picture in shifted]
    assert max(likeness) > 0.95


def _coarse(picture, size):
    """Means of darkness over 8 by 8 pixels."""
    rows, columns = size
    dark = 1 - picture[: 8 * rows, : 8 * columns].mean(axis=2)
    return dark.reshape(rows, 8, columns, 8).mean(axis=(1, 3)).ravel()
