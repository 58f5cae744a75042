"""Photos of a folder in the order of their names, or taken now, one for each pose."""

from __future__ import annotations

import re
import sys
from pathlib import Path

import numpy as np

from lrm_ident.measuring.camera.opencv import opencv
from lrm_math.errors import FileError, LrmError
from lrm_math.kinematics.poses import Poses

PICTURES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".webp")
WARM_UP = 8  # frames: old ones in the camera's queue, and its exposure


def photos_in(folder: Path) -> list[Path]:
    """The pictures of a folder by name, numbers in it as numbers. Raises `FileError`: no folder, or none in it."""
    if not folder.is_dir():
        raise FileError(folder, "", "no such folder", "a folder of photos, or the number of a camera")
    found = sorted((path for path in folder.iterdir() if path.suffix.lower() in PICTURES), key=_natural)
    if not found:
        raise FileError(folder, "", "no pictures in it", f"names end in {', '.join(PICTURES)}")
    return found


def _natural(path: Path) -> list[str | int]:
    return [int(part) if part.isdigit() else part for part in re.split(r"(\d+)", path.name)]


def take_photos(device: int, folder: Path, poses: Poses) -> list[Path]:
    """Takes a photo at every pose when the person says so; kept in `folder`. Raises `LrmError`: no such camera."""
    cv2 = opencv()
    camera = cv2.VideoCapture(device)
    if not camera.isOpened():
        raise LrmError(f"camera {device} cannot be opened")
    camera.set(cv2.CAP_PROP_FRAME_WIDTH, 1920)
    camera.set(cv2.CAP_PROP_FRAME_HEIGHT, 1080)
    folder.mkdir(parents=True, exist_ok=True)
    out = []
    try:
        for number, q in enumerate(np.degrees(poses.q), start=1):
            angles = ", ".join(f"{angle:.1f}" for angle in q)
            print(f"pose {number} of {len(poses)}: {angles} deg; stand still, then Enter", end=" ", flush=True)
            if not sys.stdin.readline():
                raise LrmError(f"stopped before pose {number}; the photos so far are in {folder}")
            for _ in range(WARM_UP):
                good, picture = camera.read()
            if not good:
                raise LrmError(f"camera {device} gives no picture at pose {number}")
            out.append(folder / f"pose{number:04d}.png")
            cv2.imwrite(str(out[-1]), picture)
    finally:
        camera.release()
    return out
