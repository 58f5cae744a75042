"""A teleoperated arm before a camera, as a LeRobot dataset with a video: stops that show the board, moves between."""

from __future__ import annotations

import json
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow
import pyarrow.parquet as parquet
from numpy.typing import NDArray

from lrm_math.arrays import Array
from validation.camera.rendered_photos import PhotoScene
from validation.camera.scene import BOARD
from validation.lerobot_dataset import Recording, encoder_readings, write_dataset

CAMERA = "observation.images.front"


@dataclass(frozen=True)
class FilmedStops:
    """Conditions of filmed stops: frames a second, of a stop and of a move; LeRobot's codec and options; episodes."""

    fps: int = 30
    rest: int = 30
    move: int = 12
    codec: str = "libsvtav1"
    options: tuple[tuple[str, str], ...] = (("crf", "30"), ("g", "2"), ("preset", "12"))
    episodes: int = 4


def write_filmed(
    folder: Path, scene: PhotoScene, q: Array, boards: Array, version: str, how: FilmedStops, seed: int = 0
) -> Path:
    """A dataset of stops at angles (N, n), rad, with the board seen at poses (N, 4, 4) in the camera's frame."""
    rng, stops = np.random.default_rng(seed), np.degrees(q)
    rows, shown, episode, t = [], [], [], []
    for number, part in enumerate(np.array_split(np.arange(len(stops)), how.episodes)):
        before, frame = stops[part[0]], 0
        for stop in part:
            shares = [*np.linspace(0.0, 1.0, how.move + 2)[1:-1], *[1.0] * how.rest]
            rows += [before + share * (stops[stop] - before) for share in shares]
            shown += [int(stop)] * len(shares)
            t += [(frame + k) / how.fps for k in range(len(shares))]
            episode += [number] * len(shares)
            frame, before = frame + len(shares), stops[stop]
    action = np.array(rows)
    made = Recording(action, encoder_readings(action, rng), np.array(t), np.array(episode))
    write_dataset(folder, made, version)
    _add_camera(folder, scene, how)
    pictures = [scene.photo(BOARD, pose, number) for number, pose in enumerate(boards)]
    for path, own in _videos(folder, made.episode, version, how).items():
        path.parent.mkdir(parents=True, exist_ok=True)
        _write_video(path, [pictures[shown[row]] for row in own], how)
    return folder


def _add_camera(folder: Path, scene: PhotoScene, how: FilmedStops) -> None:
    path = folder / "meta" / "info.json"
    info = json.loads(path.read_text())
    width, height = scene.lens.size
    info["fps"], info["chunks_size"] = how.fps, 1000
    info["features"][CAMERA] = {"dtype": "video", "shape": [height, width, 3], "names": ["height", "width", "channels"]}
    path.write_text(json.dumps(info))


def _videos(folder: Path, episode: NDArray[np.int64], version: str, how: FilmedStops) -> dict[Path, NDArray[np.int64]]:
    """The rows of each video; for v3 all in one, and where its episodes begin in it."""
    numbers = sorted(set(episode.tolist()))
    rows = {number: np.flatnonzero(episode == number) for number in numbers}
    videos = folder / "videos"
    if version == "v2.1":
        return {videos / "chunk-000" / CAMERA / f"episode_{n:06d}.mp4": rows[n] for n in numbers}
    meta = folder / "meta" / "episodes" / "chunk-000"
    meta.mkdir(parents=True)
    zeros = [0] * len(numbers)
    columns = {
        "episode_index": numbers, f"videos/{CAMERA}/chunk_index": zeros, f"videos/{CAMERA}/file_index": zeros,
        f"videos/{CAMERA}/from_timestamp": [float(rows[n][0]) / how.fps for n in numbers],
    }  # fmt: skip
    parquet.write_table(pyarrow.table(columns), meta / "file-000.parquet")
    return {videos / CAMERA / "chunk-000" / "file-000.mp4": np.arange(len(episode))}


def _write_video(path: Path, pictures: list[Any], how: FilmedStops) -> None:
    import av

    with av.open(str(path), "w") as container:
        stream: Any = container.add_stream(how.codec, rate=how.fps, options=dict(how.options))
        stream.height, stream.width = pictures[0].shape
        stream.pix_fmt = "yuv420p"
        stream.time_base = Fraction(1, how.fps)
        for number, picture in enumerate(pictures):
            frame = av.VideoFrame.from_ndarray(picture, format="gray").reformat(format="yuv420p")
            frame.pts = number
            container.mux(stream.encode(frame))
        container.mux(stream.encode())
