"""Photos of a folder in the order of their names, or taken now, one for each pose."""

from __future__ import annotations

import re
import sys
from abc import abstractmethod
from contextlib import AbstractContextManager
from pathlib import Path
from urllib.error import URLError
from urllib.request import urlopen

import numpy as np
from numpy.typing import NDArray

from lrm_ident.measuring.camera.opencv import opencv
from lrm_math.errors import FileError, LrmError
from lrm_math.kinematics.poses import Poses

PICTURES = (".png", ".jpg", ".jpeg", ".bmp", ".tif", ".tiff", ".webp")
WARM_UP = 8  # frames: old ones in the camera's queue, and its exposure
WEB = ("http://", "https://")
PATIENCE_S = 30.0  # more than the simulated webcam waits for its board on a busy computer
Picture = NDArray[np.uint8]


def photos_in(folder: Path) -> list[Path]:
    """The pictures of a folder by name, numbers in it as numbers. Raises `FileError`: no folder, or none in it."""
    if not folder.is_dir():
        raise FileError(folder, "", "no such folder", "a folder of photos, or the number of a camera")
    photos = sorted((path for path in folder.iterdir() if path.suffix.lower() in PICTURES), key=_natural)
    if not photos:
        raise FileError(folder, "", "no pictures in it", f"names end in {', '.join(PICTURES)}")
    return photos


def _natural(path: Path) -> list[str | int]:
    return [int(part) if part.isdigit() else part for part in re.split(r"(\d+)", path.name)]


class PhotoSource(AbstractContextManager["PhotoSource"]):
    """A camera that is open; a context manager of what it holds."""

    def __exit__(self, *_: object) -> None:
        return None

    @abstractmethod
    def photo(self) -> Picture:
        """A grey picture (H, W) of now. Raises `LrmError`: it gives none."""


class Webcam(PhotoSource):
    """A camera of this computer, by its number. Raises `LrmError`: there is none."""

    def __init__(self, device: int) -> None:
        cv2 = opencv()
        self._device, self._camera = device, cv2.VideoCapture(device)
        if not self._camera.isOpened():
            raise LrmError(f"camera {device} cannot be opened")
        self._camera.set(cv2.CAP_PROP_FRAME_WIDTH, 1920)
        self._camera.set(cv2.CAP_PROP_FRAME_HEIGHT, 1080)

    def __exit__(self, *_: object) -> None:
        self._camera.release()

    def photo(self) -> Picture:
        """See `PhotoSource`."""
        for _ in range(WARM_UP):
            good, picture = self._camera.read()
        if not good:
            raise LrmError(f"camera {self._device} gives no picture")
        return np.asarray(opencv().cvtColor(picture, opencv().COLOR_BGR2GRAY), dtype=np.uint8)


class WebPhotos(PhotoSource):
    """A camera on the network whose address gives a still picture, as phones' and microcontrollers' do."""

    def __init__(self, address: str) -> None:
        self._address = address

    def photo(self) -> Picture:
        """See `PhotoSource`."""
        try:
            with urlopen(self._address, timeout=PATIENCE_S) as answer:
                content = answer.read()
        except (URLError, OSError, ValueError) as error:
            raise LrmError(f"camera {self._address}: {getattr(error, 'reason', error)}") from None
        picture = opencv().imdecode(np.frombuffer(content, dtype=np.uint8), 0) if content else None
        if picture is None:
            raise LrmError(f"camera {self._address}: what it sends is no still picture")
        return np.asarray(picture, dtype=np.uint8)


def is_camera(text: str) -> bool:
    """Whether a text names a camera and not a folder."""
    return text.isdigit() or text.startswith(WEB)


def open_camera(text: str) -> PhotoSource:
    """The camera of `0` or `http://…`. Raises `LrmError`: no such camera, or neither."""
    if not is_camera(text):
        raise LrmError(f"camera {text}: should be its number, or the address of a still picture (http://…)")
    return Webcam(int(text)) if text.isdigit() else WebPhotos(text)


def keep_photo(camera: PhotoSource, folder: Path, number: int) -> Path:
    """Takes the photo of a pose by its number, kept in a folder; its path. Raises `LrmError`: the camera gives none."""
    path = folder / f"pose{number:04d}.png"
    opencv().imwrite(str(path), camera.photo())
    return path


def photograph_by_hand(camera: PhotoSource, folder: Path, poses: Poses) -> list[Path]:
    """Has a person drive to each pose and say so, a photo taken there. Raises `LrmError`: nobody says so."""
    folder.mkdir(parents=True, exist_ok=True)
    out = []
    for number, q in enumerate(np.degrees(poses.q), start=1):
        angles = ", ".join(f"{angle:.1f}" for angle in q)
        print(f"pose {number} of {len(poses)}: {angles} deg; stand still, then Enter", end=" ", flush=True)
        if not sys.stdin.readline():
            raise LrmError(f"stopped before pose {number}; the photos so far are in {folder}")
        out.append(keep_photo(camera, folder, number))
    return out
