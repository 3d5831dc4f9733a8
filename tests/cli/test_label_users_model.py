"""`label --body fit --model`, end to end, on a stand-in for a user's SMAL model."""

import json
from dataclasses import replace
from pathlib import Path

import pytest
from commands import ran
from smal_stand_in import LANDMARKS, stand_in

from animal3dbox.datasets import AnnotatedDataset, Skipped
from animal3dbox.datasets.synthetic.stanfordextra_writer import write_stanfordextra
from animal3dbox.datasets.synthetic.synthetic_set import SyntheticSet
from animal3dbox.datasets.synthetic.world.config import CLEAR
from animal3dbox.report.label_files import FitRow
from animal3dbox.report.label_reading import read_labels_json
from animal3dbox.smal.files.model_files import load_model
from animal3dbox.smal.files.pickle_writer import write_smal_pickle
from animal3dbox.smal.files.safetensors_file import save_safetensors
from animal3dbox.smal.keypoints.vocabularies import VOCABULARIES


@pytest.fixture(scope="module")
def home(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A dataset of photographs with keypoints, the model's pickle, and its landmarks."""
    folder = tmp_path_factory.mktemp("users_model")
    world = replace(CLEAR, vocabulary=VOCABULARIES["stanfordextra24"])
    write_stanfordextra(SyntheticSet(3, 3, world), folder / "photos")
    write_smal_pickle(stand_in(), folder / "smal.pkl")
    landmarks = {name: list(ids) for name, ids in LANDMARKS.items()}
    (folder / "landmarks.json").write_text(json.dumps(landmarks))
    return folder


def test_a_users_model_is_fitted_from_the_command_line(home: Path) -> None:
    code, printed = ran(
        "label", home / "photos", "--body", "fit", "--model", home / "smal.pkl",
        "--landmarks", home / "landmarks.json", "--out", home / "labels",
    )  # fmt: skip
    assert code == 0, printed
    rows = read_labels_json(home / "labels" / "labels.json").animals
    assert len(rows) == 3
    fits = [row.fit for row in rows if row.quality["body"] == "fit"]
    assert len(fits) > 1
    assert all(isinstance(fit, FitRow) and fit.body == "model" for fit in fits)


def test_a_model_without_landmarks_is_refused_with_the_remedy(home: Path) -> None:
    code, printed = ran(
        "label", home / "photos", "--body", "fit", "--model", home / "smal.pkl", "--out", home / "x"
    )
    assert code == 2
    assert "has no landmarks" in printed
    assert "--landmarks" in printed


def test_a_dataset_fits_the_model_that_it_is_given(home: Path) -> None:
    save_safetensors(load_model(home / "smal.pkl", LANDMARKS), home / "smal.safetensors")
    dataset = AnnotatedDataset(home / "photos", model=home / "smal.safetensors", body="fit")
    samples = [dataset[i] for i in range(len(dataset))]
    targets = [sample[1] for sample in samples if not isinstance(sample, Skipped)]
    records = [record for target in targets for record in target["meta"]["quality"]]
    assert {record["fit"]["body"] for record in records if record["body"] == "fit"} == {"model"}
