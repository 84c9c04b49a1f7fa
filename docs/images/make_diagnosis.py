"""Makes diagnosis.png, the picture in the README, from the report of a diagnosis of examples/synthetic_demo.csv.

cosim diagnose examples/synthetic_demo.csv --out FOLDER && python docs/images/make_diagnosis.py FOLDER
"""

import io
import shutil
import sys
from pathlib import Path

from PIL import Image
from playwright.sync_api import sync_playwright

SHOWN = ("signal-slew", "evidence-mechanical-coulomb_friction")
KEEP = """keys => {
  const main = document.querySelector('main');
  const figures = keys.map(key => document.getElementById(key).closest('figure'));
  const head = [...main.children].slice(0, [...main.children].findIndex(e => e.tagName === 'H2'));
  main.replaceChildren(...head, ...figures);
  main.style.paddingBottom = '0';
}"""


def main(folder: Path) -> None:
    """Write diagnosis.png beside this file: the report's head and two of its plots."""
    with sync_playwright() as running:
        browser = running.chromium.launch(executable_path=shutil.which("chromium"), args=["--no-sandbox"])
        page = browser.new_page(viewport={"width": 960, "height": 700})
        page.goto((folder / "report.html").absolute().as_uri())
        page.wait_for_selector("html[data-drawn]", state="attached")
        page.evaluate(KEEP, list(SHOWN))
        content = page.screenshot(full_page=True)
        browser.close()
    with Image.open(io.BytesIO(content)) as picture:
        small = picture.convert("RGB").quantize(128)
        small.save(Path(__file__).with_name("diagnosis.png"), optimize=True)


if __name__ == "__main__":
    main(Path(sys.argv[1]))
