"""The promise of a webcam: 60 rendered photos of a board on an SO-101 with a hidden effect, through the commands.

`python -m validation.camera` prints what is named, and how well the tip is known at poses that were never photographed.
"""

from __future__ import annotations

import tempfile
from pathlib import Path

from lrm_ident.data.measurement_file.write import measurements_csv
from lrm_ident.measuring.camera.board import RejectedPhoto, find_corners, read_picture
from lrm_ident.measuring.camera.capture import photos_in
from lrm_ident.measuring.camera.lens import calibrate_lens
from lrm_ident.measuring.camera.session import measure, read_photos
from lrm_ident.study.api import add, diagnose, fit, load
from lrm_math.effects.reference import effect_of
from lrm_math.model.equilibrium import solve_equilibrium
from validation.camera.rendered_photos import PhotoScene
from validation.camera.scene import BOARD, HIDDEN, poses_in_view, rig, tip_error, write_arm_photos, write_lens_photos
from validation.options import Count, asked


def main() -> None:
    """Prints the figures."""
    given = asked(__doc__, photos=Count(60), seeds=Count(2))
    with tempfile.TemporaryDirectory() as name:
        folder, scene = Path(name), PhotoScene()
        write_lens_photos(folder / "lens", scene, 20)
        corners = [find_corners(read_picture(path), BOARD) for path in photos_in(folder / "lens")]
        lens = calibrate_lens([one for one in corners if not isinstance(one, RejectedPhoto)], BOARD, scene.lens.size)
        print(f"lens: {lens.photos} photos, corners off by {lens.noise_px:.2f} px")
        for seed in range(1, given.seeds + 1):
            true = rig(seed, HIDDEN)
            poses = poses_in_view(true, given.photos, seed)
            write_arm_photos(folder / f"arm{seed}", scene, true.boards(solve_equilibrium(true.model, poses)))
            seen = read_photos(photos_in(folder / f"arm{seed}"), lens)
            found = measure(true.model.arm, "so101", poses, seen, lens, folder / f"data{seed}.csv")
            found.data.source.path.write_text(measurements_csv(found.data))
            data = load(found.data.source.path, arm="so101")
            before = fit(data)
            named = diagnose(before.model, data)
            fresh = poses_in_view(true, 100, seed + 50)
            tips = [tip_error(true, before.model, found.session, fresh)]
            if named.first:
                tips.append(
                    tip_error(true, add(before.model, data, named.first.scored.name).model, found.session, fresh)
                )
            hidden = effect_of(next(iter(HIDDEN)))
            what = named.first.scored.name if named.first else named.verdict
            print(
                f"seed {seed}: {len(seen.rows)} of {given.photos} photos used, hidden {hidden}, "
                f"named {what}; tip known to {' then '.join(f'{1e3 * tip:.2f}' for tip in tips)} mm"
            )


if __name__ == "__main__":
    main()
