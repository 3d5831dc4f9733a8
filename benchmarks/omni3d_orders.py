"""False alarms, and finds, of the order of dimensions that Omni3D boxes without corners have.

Boxes of the synthetic world are written in each order with the 2D boxes of their masks alone
(bbox2D_tight), or of the projected cuboids (bbox2D_trunc), as one file and as files of a few.

Run: OMP_NUM_THREADS=1 python benchmarks/omni3d_orders.py --images 120
"""

import argparse
import json
import tempfile
from collections.abc import Sequence
from itertools import permutations
from pathlib import Path

from kitti_false_alarms import true_boxes

from animal3dbox.datasets import CuboidRecord, CuboidSet, read_omni3d, write_omni3d

FIELDS = ("bbox2D_tight", "bbox2D_trunc", "bbox2D_proj")
SEED = 5


def named_orders(records: Sequence[CuboidRecord], order: str, field: str) -> set[str]:
    """The orders that errors name of a file whose boxes have dimensions in an order."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "boxes.json"
        write_omni3d(CuboidSet("world", tuple(records), ()), path)
        content = json.loads(path.read_text())
        content["info"] = {"id": 0}  # as of another program
        for annotation in content["annotations"]:
            by_name = dict(zip("WHL", annotation["dimensions"], strict=True))
            annotation["dimensions"] = [by_name[name] for name in order]
            annotation |= {key: [-1] * 4 for key in FIELDS if key != field}
            annotation["bbox3D_cam"] = None
        path.write_text(json.dumps(content))
        faults = read_omni3d(path).faults
    return {
        fault.problem.partition("[")[2].partition("]")[0].replace(", ", "")
        for fault in faults
        if fault.field == "dimensions"
    }


def main() -> None:
    """Print a line for each order and kind of 2D boxes."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--images", type=int, default=120)
    records = true_boxes(parser.parse_args().images, SEED)
    for field in FIELDS[:2]:
        for order in map("".join, permutations("WHL")):
            line = f"{field} {order}: one file of {len(records)}: "
            line += ", ".join(named_orders(records, order, field)) or "as documented"
            for count in (1, 5, 10, 25):
                files = [records[i : i + count] for i in range(0, len(records) - count + 1, count)]
                named = [named_orders(file, order, field) for file in files]
                right = sum(one == {order} for one in named)
                wrong = sum(bool(one) for one in named) - right
                line += f"; of {len(files)} of {count} {right} found, {wrong} misnamed"
            print(line)


if __name__ == "__main__":
    main()
