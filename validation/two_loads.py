"""Two data sets of one synthetic arm, without load and with 66.3 g, as the thesis measured but did not publish both.
`python -m validation.two_loads FOLDER` writes no-load.csv and loaded.csv for `lrm-ident options`."""

from __future__ import annotations

from pathlib import Path

from lrm_math.arm.arm_file import shipped_arms
from validation import synthetic
from validation.options import asked

ARM, POSES, SEED, NOISE = "lrm-lab", 393, 2024, 3e-4
LOADS = {"no-load": 0.0, "loaded": 0.0663}
SOURCE = "synthetic: validation.two_loads; soft play in joint 2 and a servo that turns too far, hidden"


def write(folder: Path) -> list[Path]:
    """Both data sets: 393 random poses each, errors of all 45 kinds, and two effects that no option knows."""
    arm = synthetic.load_arm(shipped_arms()[ARM])
    gain = synthetic.OneSidedGain(joint=4, side=1, gain=0.02, corner_rad=0.02)
    hidden = (synthetic.SoftPlay(joint=2, width_rad=0.02, softness_nm=0.04), gain)
    truth = synthetic.GroundTruth.random(arm, SEED, hidden)
    paths = []
    for row, (name, load) in enumerate(LOADS.items()):
        q = synthetic.random_poses(arm, POSES, SEED + row, floor_m=0.1)
        paths.append(synthetic.write(folder / name, synthetic.simulate(arm, truth, q, load, NOISE, row), SOURCE)[0])
    return paths


def main() -> None:
    """Writes them and says where."""
    for path in write(asked(__doc__, "folder").folder):
        print(path)


if __name__ == "__main__":
    main()
