"""The report that one hands on: without a network, in light and dark, on a phone and on paper."""

import numpy as np
import pytest

import losbench as lb

pytestmark = pytest.mark.browser

# Contrast of two colours as WCAG 2 has it, of every text against the page.
_CONTRAST = """() => {
    const light = text => {
        const parts = text.match(/[\\d.]+/g).slice(0, 3).map(v => v / 255)
            .map(v => v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4);
        return 0.2126 * parts[0] + 0.7152 * parts[1] + 0.0722 * parts[2];
    };
    const paper = light(getComputedStyle(document.body).backgroundColor);
    return [...document.querySelectorAll('h1, h2, h3, p, li, a, strong, th, td, figcaption')]
        .map(e => light(getComputedStyle(e).color))
        .map(ink => (Math.max(ink, paper) + 0.05) / (Math.min(ink, paper) + 0.05))
        .reduce((least, ratio) => Math.min(least, ratio), 21);
}"""


@pytest.fixture(scope="module")
def report(tmp_path_factory):
    camera = lb.Camera(focal_mm=260.0, pixel_um=10.0, shape=(60, 150))
    drift = np.linspace(0.0, 1.5, 24)[:, None, None] * [1.0, 0.5]
    light = lb.render_spots(np.array([[40.0, 30.0], [110.0, 32.0]]) + drift, 2e5, 2.0, camera.shape)
    frames = lb.Detector(read_noise_e=5.0, offset_dn=100.0).expose(light / 4.0 + 40.0, 8)
    recording = lb.read_recording(frames, period_s=5.0)
    folder = tmp_path_factory.mktemp("report")
    lb.write_report(lb.measure(recording, camera), folder, recording=recording)
    return folder / "report.html"


def test_the_report_is_whole_without_a_network(browser, report, screenshots):
    with browser.new_context(offline=True, viewport={"width": 1100, "height": 900}) as context:
        page = context.new_page()
        asked, failed = [], []
        page.on("request", lambda request: asked.append(request.url))
        page.on("console", lambda message: failed.append(message.text))
        page.goto(report.as_uri())
        (screenshots / "report.png").write_bytes(page.screenshot(full_page=True))
        blank = "[...document.images].filter(i => !i.naturalWidth).length"
        assert page.evaluate(blank) == 0
    assert [url for url in asked if not url.startswith(("data:", report.as_uri()))] == []
    assert failed == []


@pytest.mark.parametrize("scheme", ["light", "dark"])
@pytest.mark.parametrize("width", [390, 1100])
def test_it_can_be_read_by_day_and_night_and_on_a_phone(browser, report, scheme, width):
    size = {"width": width, "height": 900}
    with browser.new_context(offline=True, viewport=size, color_scheme=scheme) as context:
        page = context.new_page()
        page.goto(report.as_uri())
        assert page.evaluate("document.documentElement.scrollWidth") <= width
        assert page.evaluate(_CONTRAST) > 4.5
        assert page.evaluate("document.querySelectorAll('figure svg path').length") > 50


def test_it_prints_on_a_few_sheets_and_its_answers_come_first(browser, report):
    with browser.new_context(offline=True, color_scheme="dark") as context:
        page = context.new_page()
        page.goto(report.as_uri())
        asked = page.evaluate("[...document.querySelectorAll('.answers a')].map(a => a.innerText)")
        assert asked == [
            "Did it work?",
            "May I believe it?",
            "What is the number?",
            "What would change it?",
        ]
        printed = page.pdf(prefer_css_page_size=True)
        assert printed.startswith(b"%PDF") and 2 <= printed.count(b"/Type /Page\n") <= 12
        page.emulate_media(media="print")
        assert page.evaluate("getComputedStyle(document.body).backgroundColor") == (
            "rgb(255, 255, 255)"
        )
