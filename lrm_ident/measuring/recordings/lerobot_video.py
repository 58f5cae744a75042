"""A dataset's video as photos: the board's pose at each rest, the joints where their encoders say that they are.

Of a LeRobot dataset (v2.1: a file for each episode; v3: several episodes in one). The frames of a rest are averaged:
the arm stands, and what flickers is noise of the camera and of the compression.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np

from lrm_ident.fitting.progress import OnProgress, silent
from lrm_ident.measuring.camera.capture import Picture
from lrm_ident.measuring.camera.lens import Lens
from lrm_ident.measuring.camera.session import CameraMeasurements, measure, read_pictures
from lrm_ident.measuring.recordings.encoder_checkup import elapsed, last_sides
from lrm_ident.measuring.recordings.lerobot import Integers, LeRobotFrames, dataset_info, read_columns
from lrm_math.arm.arm import Arm
from lrm_math.arrays import Array
from lrm_math.errors import FileError, LrmError, UnknownName
from lrm_math.kinematics.poses import Poses

MOST = 5
"""Frames of a rest that are averaged."""


def camera_named(folder: Path, name: str) -> str:
    """The feature of a camera, by its whole name or its end. Raises `FileError`: no videos; `UnknownName`: not that."""
    features = dataset_info(folder)["features"]
    videos = [key for key, feature in features.items() if isinstance(feature, dict) and feature.get("dtype") == "video"]
    if not videos:
        raise FileError(folder / "meta" / "info.json", "features", "the dataset has no videos")
    for feature in videos:
        if name in (feature, feature.rpartition(".")[2]):
            return str(feature)
    raise UnknownName("video", name, videos)


def rest_pictures(
    folder: Path, camera: str, frames: LeRobotFrames, rests: Sequence[Integers], progress: OnProgress = silent
) -> Iterator[tuple[str, Picture]]:
    """Name and mean grey picture (H, W) of each rest (rows of `frames`).

    Raises `FileError`: a video is missing or ends too early.
    """
    episodes = [int(frames.episode[rows[0]]) for rows in rests]
    where, done = _located(folder, camera, set(episodes)), 0
    for path, group in groupby(zip(episodes, rests, strict=True), lambda pair: where[pair[0]][0]):
        with _opened(path) as container:
            for episode, rows in group:
                done += 1
                chosen = rows[np.unique(np.linspace(0, len(rows) - 1, MOST).astype(np.int64))]
                picture = _mean(container, path, where[episode][1] + frames.t[chosen])
                yield f"rest {done}, episode {episode} at {frames.t[chosen[0]]:.1f} s", picture
                progress(done, len(rests))


def _mean(container: Any, path: Path, times: Array) -> Picture:
    """Mean picture of the frames nearest to some times (s), which rise."""
    stream = container.streams.video[0]
    slack = 0.5 / float(stream.average_rate or 30)
    container.seek(max(0, int((times[0] - slack) / stream.time_base)), stream=stream)
    ahead, seen = times.tolist(), list[Any]()
    for frame in container.decode(stream):
        if ahead and frame.time is not None and frame.time >= ahead[0] - slack:
            seen.append(frame.to_ndarray(format="gray").astype(np.float32))
            ahead = [t for t in ahead if t - slack > frame.time]
        if not ahead:
            return np.asarray(np.round(np.mean(seen, axis=0)), dtype=np.uint8)
    raise FileError(path, "", f"the video ends before {times[-1]:.1f} s", "are all videos of the dataset whole?")


def _located(folder: Path, camera: str, episodes: set[int]) -> dict[int, tuple[Path, float]]:
    """The video of each episode, and where in it that begins (s). Raises `FileError`."""
    info, videos = dataset_info(folder), folder / "videos"
    if str(info["codebase_version"]).startswith("v2"):
        chunk = int(info.get("chunks_size", 1000))
        return {n: (videos / f"chunk-{n // chunk:03d}" / camera / f"episode_{n:06d}.mp4", 0.0) for n in episodes}
    columns = [f"videos/{camera}/{name}" for name in ("chunk_index", "file_index", "from_timestamp")]
    table = read_columns(folder / "meta" / "episodes", ("episode_index", *columns))
    located = {
        int(n): (videos / camera / f"chunk-{int(chunk):03d}" / f"file-{int(file):03d}.mp4", float(start))
        for n, chunk, file, start in zip(*table.values(), strict=True)
        if n in episodes
    }
    if missing := episodes - located.keys():
        raise FileError(folder / "meta" / "episodes", "episode_index", f"no episode {min(missing)}")
    return located


def _opened(path: Path) -> Any:
    try:
        import av
    except ImportError:
        raise LrmError("videos are read with PyAV; pip install 'lrm-arm[video]'") from None
    if not path.is_file():
        raise FileError(path, "", "no such file: the video is missing")
    try:
        container = av.open(str(path))
    except (OSError, ValueError) as error:
        raise FileError(path, "", f"cannot be read as a video ({str(error).splitlines()[0]})") from None
    if not container.streams.video:
        container.close()
        raise FileError(path, "", "has no video in it")
    return container


def measure_video(
    dataset: Path,
    camera: str,
    frames: LeRobotFrames,
    dwell: float,
    arm: Arm,
    arm_name: str,
    lens: Lens,
    on_gripper: bool,
    progress: OnProgress,
) -> CameraMeasurements:
    """Measurements from the rests of a video; with the camera `on_gripper`, of a board that stands beside the arm.

    Raises `LrmError`: no such video, no rests, a board that is never seen, or pictures that do not belong together.
    """
    name, rests = camera_named(dataset, camera), list(frames.rests(dwell))
    if not rests:
        raise LrmError(f"{dataset}: the arm makes no stop of {dwell:g} s; state a shorter one (--dwell)")
    pictures = rest_pictures(dataset, name, frames, rests, progress)
    seen = read_pictures(pictures, lens)
    if not seen.rows:
        where, why = seen.refused[0]
        raise LrmError(f"{name}: the board is seen at none of the {len(rests)} rests; {where}: {why}")
    last = np.array([rows[-1] for rows in rests])
    poses = Poses(
        q=np.array([frames.feedback[rows].mean(axis=0) for rows in rests]),
        payload=np.zeros(len(rests)),
        direction=last_sides(frames)[last],
        t=elapsed(frames)[last],
        number=np.arange(1, len(rests) + 1),
    )
    photos = seen.from_gripper if on_gripper else seen
    return measure(arm, arm_name, poses, photos, lens, dataset)
