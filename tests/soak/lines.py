"""Random straight lines inside the reach: does the commanded tip keep to them, by the independent generator?

python -m tests.soak.lines --lines 200
"""

from __future__ import annotations

import sys

from lrmd.ik.straight_line import TOLERANCE
from tests.support.daemon.random_lines import random_lines
from validation.options import Count, asked


def main() -> int:
    """Walks the lines; 1 if the tip left one by more than the tolerance."""
    options = asked(__doc__, lines=Count(200), seed=0)
    walked, ended, lines = [], 0, random_lines(options.seed)
    while len(walked) < options.lines:
        line = next(lines)
        ended += bool(line.ended)
        walked += [] if line.ended else [line]
    off = sorted(line.deviation for line in walked)
    lengths = sorted(1e3 * line.length for line in walked)
    print(f"{len(walked)} lines of {lengths[0]:.0f} to {lengths[-1]:.0f} mm; {ended} others end before their goal")
    print(f"deviation of the commanded tip: median {off[len(off) // 2] * 1e3:.2f}, largest {off[-1] * 1e3:.2f} mm")
    print(f"turn of a tool that keeps its direction: {max(line.turn for line in walked):.4f} rad at most")
    print(f"largest step of a pulse in a tick: {max(line.largest_step for line in walked)} ns")
    return int(off[-1] > TOLERANCE)


if __name__ == "__main__":
    sys.exit(main())
