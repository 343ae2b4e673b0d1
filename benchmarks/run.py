"""Measure how good and how fast trisquare is: `benchmarks/run.py [NAME...]`.

Every benchmark is a module of this folder with a function `measure`, prints what it sees and
returns the rows of the table at the end, which also replace its rows in `docs/measured.md`. All
draws are seeded; times are ratios taken in one run.
"""

from __future__ import annotations

import importlib
import os
import sys
import time

BENCHMARKS = (
    "exactness",
    "edge_bound",
    "coverage",
    "projection",
    "undistort",
    "model_choice",
    "pixel_bound",
    "lattice_bound",
    "photo_like",
    "refusals",
    "prediction",
    "tone",
    "against_zhang",
    "measured_lengths",
    "chess_triples",
    "held_out",
    "inserted_squares",
    "board_finding",
    "tags",
    "printed_target",
    "robustness",
    "real_scenes",
    "clutter_choice",
    "bad_light",
    "picture_time",
    "lattice_time",
    "solve_time",
    "command_memory",
    "large_picture",
    "hand_outlines",
    "import_time",
    "threads",
    "memory_flat",
)

# One thread each: rivals are compared by the work they do. Read when numpy is first imported.
THREAD_LIMITS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


def main(names: list[str]) -> None:
    """Run the named benchmarks, or all of them, and print one table."""
    unknown = sorted(set(names) - set(BENCHMARKS))
    if unknown:
        sys.exit(f"no benchmark {', '.join(unknown)}: choose among {', '.join(BENCHMARKS)}")
    for variable in THREAD_LIMITS:
        os.environ[variable] = "1"
    import results_page
    from rows import markdown_table

    rows = []
    for name in names or BENCHMARKS:
        module = importlib.import_module(name)
        print(f"{name}: {module.__doc__.splitlines()[0]}", flush=True)
        conditions, start = results_page.conditions(), time.perf_counter()
        found = module.measure()
        for row in found:
            print(f"  {row.measured_on}: {row.measured} / must reach {row.must_reach}")
        print(f"  ({time.perf_counter() - start:.1f} s)", flush=True)
        # At once: a run of an hour may be interrupted.
        results_page.update(name, found, BENCHMARKS, conditions)
        rows += found
    print("\n" + markdown_table(rows))


if __name__ == "__main__":
    main(sys.argv[1:])
