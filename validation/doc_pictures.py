"""Pictures of the docs that commands draw: `python -m validation.doc_pictures [MEASUREMENTS] [--only NAME]`.

Without the real measurements (`lrm-lab-no-load/measurements.csv`) those that need them are left as they are. Pictures
of the page have scripts of their own: `validation.workbench.story`, `.tutorial_pictures`, `validation.proofs.gallery`.
"""

from __future__ import annotations

import shlex
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Mapping
from pathlib import Path

from validation.options import asked

PICTURES = Path(__file__).resolve().parents[1] / "docs" / "pictures"
SERVO = Path(__file__).resolve().parents[1] / "lrm_ident" / "data" / "examples" / "one-servo.csv"
IDENT = "lrm_ident"
EXAMPLE = (f"{IDENT} example -o data.csv",)
COMMANDS: Mapping[str, tuple[str, ...]] = {
    "chosen-poses": (*EXAMPLE, f"{IDENT} choose-poses data.csv -n 50 --index O1 -o fifty.csv --figure PICTURE"),
    "diagnosis": (
        *EXAMPLE,
        f"{IDENT} fit data.csv -o model.toml",
        f"{IDENT} diagnose model.toml data.csv --figure PICTURE",
    ),
    "servo": (f"{IDENT} stiffness {SERVO} --figure PICTURE",),
    "reach": (f"{IDENT} reach lrm-rover --figure PICTURE",),
    "motion": (
        "validation.motion --only coulomb --write recording",
        f"{IDENT} motion fit recording -o motion.toml",
        f"{IDENT} motion auto motion.toml recording -o best.toml --figure PICTURE",
    ),
    "fetch": ("examples.fetch --out . --stones 20 --seed 1",),
    "design": (
        f"{IDENT} design lrm-lab --have REAL --levels '5; joint2=9' -n 20 --separate "
        "servo_gain@joint2,eccentricity@joint2 -o next.csv --figure PICTURE",
    ),
    "identifiability": (f"{IDENT} identify-parameters lrm-lab REAL --figure PICTURE",),
}
"""Modules and their arguments, in order; PICTURE is the file that is drawn, REAL the real measurements."""


def draw(name: str, real: Path | None, folder: Path) -> None:
    """Runs the commands of one picture in a folder, and puts what they drew among the pictures of the docs."""
    picture = folder / f"{name}.png"
    for line in COMMANDS[name]:
        words = [
            str(picture) if word == "PICTURE" else str(real) if word == "REAL" else word for word in shlex.split(line)
        ]
        subprocess.run([sys.executable, "-m", *words], cwd=folder, check=True, stdout=subprocess.DEVNULL)
    if picture.exists():
        shutil.copyfile(picture, PICTURES / picture.name)
    print(f"{name}: drawn", flush=True)


def main() -> None:
    """Draws all, or one."""
    given = asked(__doc__, "measurements?", only=([str], "only these", sorted(COMMANDS)))
    real = None if given.measurements is None else given.measurements.resolve()
    for name in given.only or COMMANDS:
        if real is None and any("REAL" in line for line in COMMANDS[name]):
            print(f"{name}: needs MEASUREMENTS, left as it is", flush=True)
            continue
        with tempfile.TemporaryDirectory(prefix="lrm-") as folder:
            draw(name, real, Path(folder))


if __name__ == "__main__":
    main()
