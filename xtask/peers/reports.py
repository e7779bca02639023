"""Opens every report of a folder in headless Chromium and checks what a user sees and does.

    python reports.py FOLDER
    python reports.py FOLDER PAGE.html  checks this page only
    python reports.py FOLDER PICTURE    only draws the four columns of demo.html into a PNG

Screenshots and the printed pages are left beside the reports. Exit code 1 if anything is wrong.
"""

import base64
import contextlib
import functools
import http.server
import importlib.util
import io
import os
import pathlib
import shutil
import signal
import sys
import threading
import time
import xml.etree.ElementTree

from PIL import Image, ImageChops
from selenium import webdriver
from selenium.webdriver.common.action_chains import ActionChains
from selenium.webdriver.common.by import By
from selenium.webdriver.common.keys import Keys

TIME_LIMIT_S = 1200
OPEN_LIMIT_S = 2.0
SIZE_LIMIT = 10_000_000
# Whether slow pages are failures: they are told in any case, but a busy machine makes any page slow.
HOLD_TIMES = "--times" in sys.argv
# Attempts at a time that is held: other work on the machine may disturb one of them.
ATTEMPTS = 3 if HOLD_TIMES else 1
# Pictures of which the rate is taken: one turn, or an eighth where nothing depends on it.
TURN = 24 if HOLD_TIMES else 3
# Pictures a second while the view turns; twelve frames without a graphics card are enough to follow.
LEAST_RATE = 5.0
# Pixels, each of two CSS pixels a side, that must change when something is switched.
LEAST_CHANGE = 60


class Failures(list):
    def expect(self, holds, words):
        if not holds:
            print(f"  WRONG: {words}", flush=True)
            self.append(words)


def browser(folder):
    options = webdriver.ChromeOptions()
    for flag in ("--headless=new", "--no-sandbox", "--disable-dev-shm-usage", "--use-angle=swiftshader",
                 "--enable-unsafe-swiftshader", "--window-size=1400,1000", "--hide-scrollbars", "--force-device-scale-factor=1"):
        options.add_argument(flag)
    options.binary_location = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
    options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
    options.add_experimental_option("prefs", {"download.default_directory": str(folder), "download.prompt_for_download": False,
                                               "profile.default_content_setting_values.automatic_downloads": 1})
    service = webdriver.ChromeService(executable_path=shutil.which("chromedriver"))
    driver = webdriver.Chrome(options=options, service=service)
    driver.set_page_load_timeout(110)
    driver.set_script_timeout(110)
    return driver


@contextlib.contextmanager
def served(folder):
    class Quiet(http.server.SimpleHTTPRequestHandler):
        def log_message(self, *_):
            pass

    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), functools.partial(Quiet, directory=str(folder)))
    thread = threading.Thread(target=server.serve_forever, daemon=True)
    thread.start()
    try:
        yield f"http://127.0.0.1:{server.server_port}"
    finally:
        server.shutdown()


def cpu_seconds(root):
    """Processor time of a process and all below it: what a machine with nothing else to do would need at most."""
    stats = {}
    for entry in pathlib.Path("/proc").iterdir():
        if entry.name.isdigit():
            with contextlib.suppress(OSError):
                fields = (entry / "stat").read_text().rpartition(")")[2].split()
                stats[int(entry.name)] = (int(fields[1]), int(fields[11]) + int(fields[12]))
    wanted = {root}
    while new := {pid for pid, (parent, _) in stats.items() if parent in wanted} - wanted:
        wanted |= new
    return sum(ticks for pid, (_, ticks) in stats.items() if pid in wanted) / os.sysconf("SC_CLK_TCK")


class Page:
    def __init__(self, driver, path, failures):
        self.driver, self.path, self.failures = driver, path, failures

    def js(self, script, *arguments):
        return self.driver.execute_script(script, *arguments)

    def cpu(self):
        return cpu_seconds(self.driver.service.process.pid)

    def open(self, url):
        self.driver.get(url)
        seconds = self.js("""
            if (window.viewer) { const gl = viewer.renderer.gl; gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, new Uint8Array(4)); }
            return performance.now() / 1000;""")
        self.failures.expect(self.js("return document.documentElement.dataset.ready") == "yes", "the scripts did not run to their end")
        return seconds

    def console(self):
        for entry in self.driver.get_log("browser"):
            # Reading one pixel back, which only this test does, is worth a remark to the browser.
            if "GPU stall due to ReadPixels" not in entry["message"]:
                self.failures.expect(False, f"console: {entry['level']} {entry['message']}")

    def picture(self):
        """What is drawn, coarsely."""
        data = self.js("viewer.draw(0.5); clearTimeout(viewer.rest); return viewer.canvas.toDataURL()")
        return Image.open(io.BytesIO(base64.b64decode(data.split(",")[1]))).convert("RGB")

    def seen(self):
        """What of it the window shows."""
        self.js("document.getElementById('view').scrollIntoView({behavior: 'instant'}); viewer.draw(1); clearTimeout(viewer.rest);")
        canvas = self.driver.find_element(By.ID, "canvas")
        return Image.open(io.BytesIO(canvas.screenshot_as_png)).convert("RGB")

    def save(self, name):
        self.driver.save_screenshot(str(self.path.with_name(f"{self.path.stem}-{name}.png")))


def changed(before, after):
    difference = ImageChops.difference(before, after).convert("L").point(lambda v: 255 if v > 24 else 0)
    return difference.histogram()[255]


def expect_change(page, what, action, back=None):
    before = page.picture()
    action()
    after = page.picture()
    n = changed(before, after)
    page.failures.expect(n >= LEAST_CHANGE, f"{what} changed only {n} pixels")
    if back:
        back()
        n = changed(before, page.picture())
        page.failures.expect(n < LEAST_CHANGE, f"{what} was not undone: {n} pixels differ")


def click(page, css):
    page.js("arguments[0].click()", page.driver.find_element(By.CSS_SELECTOR, css))


def choose(page, name, value):
    page.js("const s = document.getElementById(arguments[0]); s.value = arguments[1]; s.dispatchEvent(new Event('change'));", name, value)


# Where the middle of every screw of a role is in the picture, in CSS pixels.
PLACES = """
const out = [], columns = viewer.scene.layouts[viewer.state.layout].columns, [w, h] = viewer.columnSize();
columns.forEach((column, k) => {
  const m = viewer.projection(column.panel, [w, h]).clipFromPanel;
  for (const s of viewer.screws) {
    if (s.panel !== column.panel || s.role !== arguments[0] || !column.roles.includes(s.role)) continue;
    for (const t of [0.25, 0.4, 0.55, 0.7]) {
      const p = s.entry.map((x, i) => x + (s.tip[i] - x) * t), c = math.place(m, p);
      out.push([(k + 0.5 + c[0] / 2) * w, (0.5 - c[1] / 2) * h, s.name, s.accepted]);
    }
  }
});
return out;"""


def is_blue(p):
    return p[2] > 1.4 * p[0] and p[2] > 40


def is_red(p):
    return p[0] > 1.8 * p[2] and p[0] > 1.8 * p[1] and p[0] > 40


def check_screws(page, role, has_color, color):
    """Only this role, without bone: its colour is where its screws are."""
    page.js("""for (const r of Object.keys(viewer.state.roles)) viewer.state.roles[r] = r === arguments[0];
               viewer.set({hasSurfaces: false});""", role)
    picture, places = page.seen(), page.js(PLACES, role)
    page.failures.expect(len(places) > 0, f"no {role} screw is in the view")
    missing = sorted({name for x, y, name, accepted in places if accepted and not has_color(picture.getpixel((round(x), round(y))))})
    page.failures.expect(not missing, f"{role} screws are not {color}: {missing}")
    # A rejected screw is striped: dark in places, but not everywhere.
    for name in {name for _, _, name, accepted in places if not accepted}:
        found = [has_color(picture.getpixel((round(x), round(y)))) for x, y, n, _ in places if n == name]
        page.failures.expect(any(found), f"the rejected screw {name} shows no {color}")
    page.js("for (const r of Object.keys(viewer.state.roles)) viewer.state.roles[r] = true; viewer.set({hasSurfaces: true});")


def check_view(page, is_thorough):
    roles = page.js("return [...new Set(viewer.scene.screws.map((s) => s.role))]")
    page.js("document.getElementById('view').scrollIntoView({behavior: 'instant'})")
    page.save("view")
    for role in roles:
        check_screws(page, role, is_red if role == "transferred" else is_blue, "red" if role == "transferred" else "blue")
    if not is_thorough:
        return
    for button in page.driver.find_elements(By.CSS_SELECTOR, "#directions button"):
        if button.get_attribute("aria-pressed") != "true":
            name = button.text
            expect_change(page, f"view {name}", lambda: page.js("arguments[0].click()", button))
            page.failures.expect(button.get_attribute("aria-pressed") == "true", f"button {name} does not say that it is pressed")
    page.js("viewer.reset()")
    for k in range(1, page.js("return viewer.scene.layouts.length")):
        expect_change(page, f"layout {k}", lambda: choose(page, "layout", k), lambda: choose(page, "layout", 0))
    if page.js("return viewer.scene.layouts.length") > 3:
        choose(page, "layout", 3)
        page.js("viewer.look(180, 0)")
        page.seen()
        page.save("four-columns")
        choose(page, "layout", 0)
        page.js("viewer.reset()")
    first = page.js("return viewer.state.layer") + 1
    for k in range(page.js("return viewer.scene.layers.length + 1")):
        if k != first:
            expect_change(page, f"colours {k}", lambda: choose(page, "layer", k), lambda: choose(page, "layer", first))
    for box in page.driver.find_elements(By.CSS_SELECTOR, "#groups input, #structures input[type=checkbox], #roles input"):
        flip = lambda: page.js("arguments[0].click()", box)
        label = box.find_element(By.XPATH, "..").text
        expect_change(page, f"switch '{label}'", flip, flip)
    for slider in page.driver.find_elements(By.CSS_SELECTOR, "#opacity, #structures input[type=range]"):
        move = lambda value: page.js("arguments[0].value = arguments[1]; arguments[0].dispatchEvent(new Event('input'))", slider, value)
        before = slider.get_attribute("value")
        expect_change(page, "a slider of opacity", lambda: move(0.1), lambda: move(before))
    if page.js("return viewer.scene.screws.length > 0"):
        check_cut(page)


def check_cut(page):
    name = page.js("return viewer.scene.screws[4 % viewer.scene.screws.length].name")
    choose(page, "cut-kind", "along")
    expect_change(page, "a cut", lambda: choose(page, "cut-screw", name))
    for kind in ("level", "across"):
        expect_change(page, f"a cut {kind}", lambda: choose(page, "cut-kind", kind))
    expect_change(page, "the other half", lambda: click(page, "#cut-flip"), lambda: click(page, "#cut-flip"))
    choose(page, "cut-screw", "")
    expect_change(page, "a card's button", lambda: click(page, "[data-show]"))
    time.sleep(0.3)
    page.seen()
    page.save("cut")
    choose(page, "cut-screw", "")
    page.js("viewer.reset()")


def check_keyboard(page):
    """Every control can be reached by Tab and shows that it is."""
    page.js("window.scrollTo(0, 0); document.activeElement.blur();")
    n = page.js("""return [...document.querySelectorAll('a[href], button, input, select, [tabindex="0"]')]
        .filter((e) => e.getClientRects().length > 0).length""")
    seen = set()
    for _ in range(n + 3):
        ActionChains(page.driver).send_keys(Keys.TAB).perform()
        found = page.js("""const e = document.activeElement, s = getComputedStyle(e);
            if (e === document.body) return null;
            window.reached = window.reached || new Map(); if (!reached.has(e)) reached.set(e, reached.size);
            return [reached.get(e), e.id || e.textContent || e.getAttribute('aria-label'), s.outlineStyle, parseFloat(s.outlineWidth)]""")
        if found is None:
            continue
        seen.add(found[0])
        page.failures.expect(found[2] not in ("none", "") and found[3] >= 2, f"the focus on '{found[1]}' cannot be seen")
    page.failures.expect(len(seen) >= n - 1, f"Tab reaches {len(seen)} of {n} controls")
    if not page.js("return Boolean(window.viewer)"):
        return
    page.js("document.getElementById('canvas').focus()")
    for keys, what in ((Keys.ARROW_LEFT, "arrow key"), ("+", "plus key"), (Keys.SHIFT + Keys.ARROW_UP + Keys.NULL, "shift and arrow")):
        expect_change(page, what, lambda: ActionChains(page.driver).send_keys(keys).perform())
    expect_change(page, "R", lambda: ActionChains(page.driver).send_keys("r").perform())


def check_pointer(page):
    if not page.js("return Boolean(window.viewer)"):
        return
    page.js("document.getElementById('view').scrollIntoView({behavior: 'instant'})")
    canvas = page.driver.find_element(By.ID, "canvas")
    drag = ActionChains(page.driver).move_to_element(canvas).click_and_hold().move_by_offset(60, 20).release()
    expect_change(page, "a drag", drag.perform)
    box = page.js("const r = document.getElementById('canvas').getBoundingClientRect(); return [r.x + r.width / 2, r.y + r.height / 2]")

    def pinch():
        for kind, reach in (("touchStart", 40), ("touchMove", 60), ("touchMove", 90), ("touchEnd", 0)):
            points = [{"x": box[0] + s * reach, "y": box[1], "id": k} for k, s in enumerate((-1, 1))] if reach else []
            page.driver.execute_cdp_cmd("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})

    before = page.js("return viewer.state.zoom")
    expect_change(page, "a pinch", pinch)
    page.failures.expect(page.js("return viewer.state.zoom") > 1.5 * before, "a pinch does not zoom")
    page.js("viewer.reset()")


def check_saving(page):
    folder = page.path.parent
    wanted = [("[data-save=csv]", "*.csv"), ("[data-save=svg]", "*.svg")]
    if page.js("return Boolean(window.viewer)"):
        wanted.append(("#screenshot", "view*.png"))
    for css, pattern in wanted:
        for old in folder.glob(pattern):
            old.unlink()
        if not page.driver.find_elements(By.CSS_SELECTOR, css):
            continue
        click(page, css)
        end = time.monotonic() + 20
        while not any(f.stat().st_size for f in folder.glob(pattern)) and time.monotonic() < end:
            time.sleep(0.1)
        files = list(folder.glob(pattern))
        page.failures.expect(bool(files), f"{css} saved nothing")
        for file in files:
            if file.suffix == ".svg":
                root = xml.etree.ElementTree.parse(file).getroot()
                page.failures.expect(root.find("{http://www.w3.org/2000/svg}style") is not None, f"{file.name} has no style of its own")
            elif file.suffix == ".png":
                page.failures.expect(len(Image.open(file).convert("RGB").resize((64, 64)).getcolors(4096)) > 20, "the saved picture is empty")
            file.unlink()


def check_themes(page, axe):
    shades = []
    for theme in ("light", "dark"):
        if page.js("return document.documentElement.dataset.theme") != theme:
            click(page, "#theme")
        shades.append(page.js("return getComputedStyle(document.body).backgroundColor"))
        page.js(axe)
        found = page.driver.execute_async_script("const done = arguments[0]; axe.run(document, {resultTypes: ['violations']}).then((r) => done(r.violations))")
        for violation in found:
            places = "; ".join(n["html"][:120] for n in violation["nodes"][:3])
            page.failures.expect(False, f"axe, {theme}: {violation['id']} ({violation['impact']}): {violation['help']}: {places}")
        page.js("window.scrollTo(0, 0)")
        time.sleep(0.5)
        page.save(theme)
    page.failures.expect(shades[0] != shades[1], "light and dark look the same")
    click(page, "#theme")


def check_sizes(page):
    page.driver.set_window_size(500, 900)
    time.sleep(0.5)
    page.failures.expect(page.js("return document.documentElement.scrollWidth <= innerWidth + 1"), "a narrow window scrolls sideways")
    page.js("window.scrollTo(0, 0)")
    page.save("narrow")
    page.driver.set_window_size(1400, 1000)
    printed = page.driver.execute_cdp_cmd("Page.printToPDF", {"printBackground": True})["data"]
    page.failures.expect(len(printed) > 20_000, "the printed page is empty")


def rate(page):
    """Pictures a second while the view turns; a second of processor time where the machine has other work."""
    before = page.cpu()
    pictures = page.driver.execute_async_script("""
        const [turn, done] = arguments; let n = 0; const start = performance.now();
        const step = () => {
          if (n === turn) { done(1000 * n / (performance.now() - start)); return; }
          n += 1; viewer.turn(15, 0);
          requestAnimationFrame(() => {
            const gl = viewer.renderer.gl; gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, new Uint8Array(4)); step();
          });
        };
        step();""", TURN)
    return max(pictures, TURN / max(page.cpu() - before, 0.01))


# Pages of the same kind as another one: only what differs is looked at.
ALIKE = ("transfer.html", "rejected.html", "check.html", "plan.html")


def check_page(driver, path, address, axe):
    print(f"--- {path.name}", flush=True)
    failures = Failures()
    is_thorough = path.name not in ALIKE
    page = Page(driver, path, failures)
    size = path.stat().st_size
    failures.expect(size < SIZE_LIMIT, f"{size} bytes are too many")
    seconds = []
    for url in (f"{address}/{path.name}", path.as_uri()):
        for _ in range(ATTEMPTS):
            seconds.append(page.open(url))
            if seconds[-1] < OPEN_LIMIT_S:
                break
        page.console()
    failures.expect(not HOLD_TIMES or min(seconds) < OPEN_LIMIT_S, f"opened in {min(seconds):.2f} s")
    outside = page.js("return performance.getEntriesByType('resource').map((e) => e.name).filter((n) => !n.startsWith('data:') && !n.startsWith('blob:'))")
    failures.expect(not outside, f"other files are asked for: {outside}")
    pictures = 0.0
    if page.js("return Boolean(window.viewer)"):
        check_view(page, is_thorough)
        for _ in range(ATTEMPTS):
            pictures = max(pictures, rate(page))
            if pictures >= LEAST_RATE:
                break
        failures.expect(not HOLD_TIMES or pictures >= LEAST_RATE, f"turns at {pictures:.1f} pictures a second")
        page.js("viewer.reset()")
    if is_thorough:
        check_pointer(page)
        check_keyboard(page)
        check_saving(page)
        check_sizes(page)
    check_themes(page, axe)
    page.console()
    print(f"{path.name}: {size / 1e6:.2f} MB, opened in {min(seconds):.2f} s, {pictures:.1f} pictures a second, {len(failures)} wrong", flush=True)
    return len(failures)


def draw_picture(folder, picture):
    driver = browser(folder)
    try:
        driver.set_window_size(1400, 760)
        page = Page(driver, folder / "demo.html", Failures())
        page.open(page.path.as_uri())
        page.js("document.querySelector('.viewer').style.gridTemplateColumns = '1fr'; document.getElementById('controls').hidden = true; viewer.set({layout: 3}); viewer.look(180, 0);")
        time.sleep(1)
        page.js("document.getElementById('view').scrollIntoView({behavior: 'instant'}); viewer.draw(2); clearTimeout(viewer.rest);")
        stage = driver.find_element(By.CSS_SELECTOR, ".stage")
        image = Image.open(io.BytesIO(stage.screenshot_as_png)).convert("RGB")
        image.quantize(200, dither=Image.Dither.NONE).save(picture, optimize=True)
    finally:
        driver.quit()


def main():
    signal.alarm(TIME_LIMIT_S)
    folder = pathlib.Path(sys.argv[1]).resolve()
    named = [a for a in sys.argv[2:] if not a.startswith("--")]
    only = named[0] if named else ""
    if only.endswith(".png"):
        draw_picture(folder, only)
        return
    package = importlib.util.find_spec("axe_playwright_python")
    axe = (pathlib.Path(package.submodule_search_locations[0]) / "axe.min.js").read_text()
    pages = sorted(p for p in folder.glob("*.html") if only in ("", p.name))
    if not pages:
        sys.exit(f"{folder}: no report")
    n_wrong = 0
    driver = browser(folder)
    try:
        with served(folder) as address:
            for path in pages:
                n_wrong += check_page(driver, path, address, axe)
    finally:
        driver.quit()
    sys.exit(1 if n_wrong else 0)


if __name__ == "__main__":
    main()
