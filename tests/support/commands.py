"""Running commands in this process, and what they need on disk."""

import contextlib
import io
from dataclasses import asdict
from pathlib import Path

import pytest

from animal3dbox import CuboidLabel, LabelConfig, label_animal
from animal3dbox.cli.main import main
from animal3dbox.datasets.synthetic.scenes import synthetic_animal
from animal3dbox.report.label_files import LabelFile, RejectedRow, animal_row, write_labels_json


def ran(*arguments: str | Path) -> tuple[int, str]:
    """Run a command; its exit code and all that it printed."""
    output = io.StringIO()
    with (
        pytest.raises(SystemExit) as left,
        contextlib.redirect_stdout(output),
        contextlib.redirect_stderr(output),
    ):
        main([str(a) for a in arguments])
    assert isinstance(left.value.code, int)
    return left.value.code, output.getvalue()


def labels_of_one_animal(folder: Path) -> Path:
    """A folder as ``label`` writes it: the label of a synthetic animal, and one animal without."""
    animal = synthetic_animal(seed=0, index=2)
    label = label_animal(
        image_hw=animal.image_hw, keypoints_2d=animal.keypoints_2d, vertices=animal.vertices,
        faces=animal.model.faces,
        template=animal.model, K=animal.K, mask=animal.mask, sample_id="a.jpg",
    )  # fmt: skip
    assert isinstance(label, CuboidLabel)
    row = animal_row(label, image="herd/a.jpg", animal=0, category="dog")
    rejected = RejectedRow(
        sample_id="a.jpg#1", image="herd/a.jpg", animal=1, reason="no_pose", detail="none"
    )
    write_labels_json(
        folder / "labels.json",
        LabelFile(body="dog", config=asdict(LabelConfig()), animals=[row], rejected=[rejected]),
    )
    return folder
