"""The picture of docs/fleet.md, of a real page: `python -m validation.fleet.picture PICTURE`.

24 simulated arms of one kind, 60 poses each, identified by `lrm-ident fleet`; then a screenshot of `fleet.html`.
"""

from __future__ import annotations

import sys
from pathlib import Path
from subprocess import DEVNULL, run
from tempfile import TemporaryDirectory

from tests.support.browser import PATIENCE_MS, chromium
from validation.fleet.simulated_fleet import simulated_fleet, write_fleet

ARMS, SEED, POSES = 24, 2, 60
WIDTH, HEIGHT, SETTLE_MS = 1000, 1210, 2000


def main() -> None:
    """Draws the picture."""
    picture = Path(sys.argv[1])
    with TemporaryDirectory(prefix="fleet-") as scratch, chromium() as browser:
        folder = Path(scratch)
        manifest = write_fleet(simulated_fleet(ARMS, SEED), folder / "data", POSES)
        run([sys.executable, "-m", "lrm_ident", "fleet", manifest, "-o", folder / "out"], check=True, stdout=DEVNULL)
        page = browser.new_page(viewport={"width": WIDTH, "height": HEIGHT}, color_scheme="light")
        page.set_default_timeout(PATIENCE_MS)
        page.goto((folder / "out" / "fleet.html").as_uri())
        page.wait_for_timeout(SETTLE_MS)
        page.screenshot(path=picture)


if __name__ == "__main__":
    main()
