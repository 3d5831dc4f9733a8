"""Command line: `python -m animal3dbox.smal.quadruped.modelling OUT.npz`."""

import argparse
import time
from pathlib import Path

from animal3dbox.smal.quadruped.modelling.assemble import build_parts
from animal3dbox.smal.quadruped.modelling.asset import write_asset


def main() -> None:
    """Build the embedded quadruped and write it."""
    parser = argparse.ArgumentParser(description="Build the embedded quadruped.")
    parser.add_argument("out", type=Path, help="the .npz to write")
    out: Path = parser.parse_args().out
    start = time.perf_counter()
    parts = build_parts()
    write_asset(parts, out)
    count = 2 * len(parts.half.vertices) - parts.half.seam
    seconds = time.perf_counter() - start
    print(
        f"{out}: {count} vertices, {len(parts.columns)} columns,"
        f" {out.stat().st_size / 1e6:.2f} MB, {seconds:.0f} s"
    )


if __name__ == "__main__":
    main()
