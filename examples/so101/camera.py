"""`python -m examples.so101.camera LINK PORT [FOLDER]`: a webcam beside the simulated SO-101, until that ends.

It sees the board on the gripper: each request of http://127.0.0.1:PORT/photo.jpg is answered with a picture of now, as
a phone answers it that serves as a webcam. In a folder it leaves `lens-photos`, 15 photos of a board held by hand,
`poses.csv`, 60 poses at which it sees the board, and `goals.csv`, tips of ten others.
"""

from __future__ import annotations

import sys
import threading
import time
from http.server import BaseHTTPRequestHandler, HTTPServer
from itertools import count
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from examples.so101.tracker import arm_answers
from lrm_ident.data.rigid_motion import inverse
from lrm_ident.measuring.camera.opencv import opencv
from lrm_math.arm.arm_file import MM, load_arm
from lrm_math.arrays import Array
from lrm_math.command_line import OneLineParser
from lrm_math.errors import LrmError
from lrm_math.kinematics.poses import poses_of
from lrm_math.model.equilibrium import solve_equilibrium
from lrm_math.model.model import model_of
from lrmd.sim.control_socket import ControlError, control_path, query_board
from validation.camera.rendered_photos import PhotoScene
from validation.camera.scene import BOARD, CAMERA, CameraRig, board_mount, poses_in_view, write_lens_photos

PAGE = "/photo.jpg"
QUALITY = 95
SCENE = PhotoScene()
ARM = load_arm("so101")
DRAWN = CameraRig(model_of(ARM, ()), CAMERA, board_mount(ARM))
"""The arm as drawn, the board on it, and where the camera stands."""
LENS_PHOTOS, POSES, GOALS = 15, 60, 10
NEAR = np.radians(12.0)
"""rad: a short move, which friction remembers."""

LATE_S = 20.0
"""A board that has not answered for so long is gone."""


def jpeg(tool: Array, number: int) -> bytes:
    """The photo of that number, with the tool's frame at (4, 4) in the arm's (m)."""
    cv2 = opencv()
    picture: NDArray[np.uint8] = SCENE.photo(BOARD, inverse(DRAWN.camera) @ tool @ DRAWN.mount, number)
    return bytes(cv2.imencode(".jpg", picture, [cv2.IMWRITE_JPEG_QUALITY, QUALITY])[1])


def poses_for_photos(count: int, seed: int) -> Array:
    """(count, n), rad: poses that show the board, half of them a short move from the one before."""
    rng, found = np.random.default_rng([seed, 9]), list[Array]()
    for far in poses_in_view(DRAWN, 2 * count, seed).q:
        near = far + rng.uniform(-NEAR, NEAR, ARM.dof)
        if bool(DRAWN.shows(near[None])[0]):
            found += [far, near]
    return np.array(found[:count])


def server(link: Path, port: int) -> HTTPServer:
    """Serves photos of the arm at a device; it shuts down when that is gone, not when a busy computer is late."""
    numbers = count()

    def tool() -> Array:
        end = time.monotonic() + LATE_S
        while True:
            try:
                return np.array(query_board(link, "tool")["tool"])
            except ControlError:
                if time.monotonic() > end or not control_path(link).exists():
                    raise

    class Answer(BaseHTTPRequestHandler):
        """Answers with a photo."""

        def do_GET(self) -> None:
            """A photo of now."""
            try:
                seen = tool()
            except ControlError:
                threading.Thread(target=serving.shutdown).start()
                self.send_error(503)
                return
            content = jpeg(seen, next(numbers))
            self.send_response(200)
            self.send_header("Content-Type", "image/jpeg")
            self.send_header("Content-Length", str(len(content)))
            self.end_headers()
            self.wfile.write(content)

        def log_message(self, *_: object) -> None:
            """Says nothing."""

    serving = HTTPServer(("127.0.0.1", port), Answer)
    return serving


def write_files(folder: Path) -> None:
    """What a person has before the arm is measured: photos for the lens, poses, and goals."""
    write_lens_photos(folder / "lens-photos", SCENE, LENS_PHOTOS)
    header = ",".join(f"q{joint}_deg" for joint in range(1, ARM.dof + 1))
    np.savetxt(folder / "poses.csv", np.degrees(poses_for_photos(POSES, 1)), "%.3f", ",", header=header, comments="")
    tips = solve_equilibrium(DRAWN.model, poses_of(poses_for_photos(2 * GOALS, 2)[::2])).tcp
    np.savetxt(folder / "goals.csv", tips / MM, "%.1f", ",", header="x_mm,y_mm,z_mm", comments="")


def main() -> None:
    """Serves photos. A wrong command line, or no arm, is one line on stderr and exit code 2."""
    usage = "python -m examples.so101.camera LINK PORT [FOLDER]"
    parser = OneLineParser("python -m examples.so101.camera", usage, "A webcam beside the simulated SO-101.")
    parser.add_argument("link", metavar="LINK", type=Path, help="device of the simulated arm, such as /tmp/so101")
    parser.add_argument("port", metavar="PORT", type=int, help="of http://127.0.0.1:PORT/photo.jpg")
    parser.add_argument("folder", metavar="FOLDER", type=Path, nargs="?", help="for lens-photos and poses.csv")
    try:
        given = parser.parse_args()
        if not arm_answers(given.link, LATE_S):
            started = f"start it first: python -m examples.so101 {given.link} gain 1"
            raise LrmError(f"{given.link}: no simulated arm; {started}")
    except LrmError as error:
        print(f"error: {error}", file=sys.stderr)
        sys.exit(2)
    if given.folder is not None:
        write_files(given.folder)
    with server(given.link, given.port) as serving:
        print(f"a camera at http://127.0.0.1:{serving.server_address[1]}{PAGE}", flush=True)
        serving.serve_forever()


if __name__ == "__main__":
    main()
