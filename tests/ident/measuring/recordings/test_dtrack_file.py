"""A file of DTrack's ASCII output: what a live tracker would have given, or one line that says why not."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from lrm_ident.measuring.recordings.readers import read_take
from lrm_math.errors import FileError

places = st.lists(st.floats(-2000.0, 2000.0), min_size=3, max_size=3)
frames = st.lists(st.dictionaries(st.integers(0, 3), places, max_size=4), min_size=1, max_size=8)


def frame(number: int, t: float, targets: dict[int, list[float]], turn: Rotation) -> str:
    """One datagram as the manual has it: positions in mm, the rotation matrix by columns."""
    R = " ".join(f"{x:.6f}" for x in turn.as_matrix().T.ravel())
    seen = "".join(
        f"[{name} 1.000][{x:.3f} {y:.3f} {z:.3f} 0 0 0][{R}]{' ' if k + 1 < len(targets) else ''}"
        for k, (name, (x, y, z)) in enumerate(targets.items())
    )
    return f"fr {number}\nts {t:.6f}\n6dcal 4\n6d {len(targets)} {seen}\n"


@given(frames, st.integers(0, 100), st.booleans())
def test_every_target_is_a_body_and_nan_where_it_was_not_seen(
    tmp_path_factory: pytest.TempPathFactory, taken: list[dict[int, list[float]]], seed: int, cut: bool
) -> None:
    turn = Rotation.random(random_state=seed)
    text = "".join(frame(7 + k, 40000.0 + 0.0166 * k, one, turn) for k, one in enumerate(taken))
    path = tmp_path_factory.mktemp("take") / "take.txt"
    path.write_text(text + ("fr 99\nts 40" if cut else ""))
    numbers = {number for one in taken for number in one}
    if not numbers:
        with pytest.raises(FileError, match="no target was seen"):
            read_take(path)
        return
    take = read_take(path)
    assert set(take.bodies) == {str(number) for number in numbers}
    np.testing.assert_allclose(take.t, 40000.0 + 0.0166 * np.arange(len(taken)), atol=1e-5)
    for name, body in take.bodies.items():
        for row, one in enumerate(taken):
            if int(name) not in one:
                assert np.isnan(body.position[row]).all()
                continue
            np.testing.assert_allclose(body.position[row], 1e-3 * np.array(one[int(name)]), atol=1e-6)
            assert body.rotation is not None
            np.testing.assert_allclose(body.rotation[row], turn.as_matrix(), atol=1e-5)


def test_a_frame_that_cannot_be_read_is_named_by_its_line(tmp_path: Path) -> None:
    good = frame(1, 1.0, {1: [1.0, 2.0, 3.0]}, Rotation.identity())
    path = tmp_path / "take.txt"
    path.write_text(good + "fr 2\n6d 0\n" + good)
    with pytest.raises(FileError, match=r"line 5.*ts"):
        read_take(path)
