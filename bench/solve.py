"""Time and accuracy of the solve at the paper's size: 15 bays, 5 to 11 levels, a bridge bay, 1000 frames.

python bench/solve.py [--frames 1000] [--outliers 0.03]
"""

import argparse
import resource
import sys
import time
from pathlib import Path

import numpy as np

ROOT = Path(__file__).resolve().parent.parent
sys.path[:0] = [str(ROOT), str(ROOT / "plugins/shelves"), str(ROOT / "tests/integration/racks")]


def main() -> None:
    import made_up_rack as made

    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--frames", type=int, default=1000)
    parser.add_argument("--outliers", type=float, default=0.03)
    given = parser.parse_args()
    world = made.world(0, 15, given.frames, levels=(5, 11), bridge=7, outliers=given.outliers)
    begin = made.begin(world, speed=1.3, height=0.3, distance=1.3)
    wall, processor = time.perf_counter(), time.process_time()
    solution = made.solved(world, begin)
    wall, processor = time.perf_counter() - wall, time.process_time() - processor
    x, y, sigma_x, sigma_y = made.errors(world, solution)
    print(
        f"{solution.report['observations']} observations of {solution.report['landmarks']} points in {given.frames} frames"
    )
    print(
        f"solved in {wall:.1f} s ({processor:.1f} s of processor time), peak {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e6:.2f} GB"
    )
    for axis, off, sigma in (("x", x[1:], sigma_x[1:]), ("height", y, sigma_y)):
        normal = float(np.sqrt(np.mean((off / sigma) ** 2)))
        print(
            f"{axis:>6}: mean error {1e3 * np.abs(off).mean():.1f} mm, largest {1e3 * np.abs(off).max():.1f} mm, error / sigma {normal:.2f}"
        )


if __name__ == "__main__":
    main()
