"""The parameters of a fit, kept in labels and files, pose the very same body again."""

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from animal3dbox import CuboidLabel, label_animal
from animal3dbox.datasets.labelling.label_codec import packed_outcome, unpacked_outcome
from animal3dbox.datasets.labelling.scale import in_metres
from animal3dbox.datasets.synthetic.scenes import synthetic_animal
from animal3dbox.errors import ConfigError
from animal3dbox.labels.fit.fit import fit_animal
from animal3dbox.labels.fit.fitted_body import FittedBody
from animal3dbox.labels.fit_parameters import FitParameters, fitted_vertices
from animal3dbox.report.label_files import FitRow, LabelFile, animal_row, write_labels_json
from animal3dbox.report.label_reading import read_labels_json
from animal3dbox.smal.quadruped.preset_bodies import load_quadruped

ANIMAL = synthetic_animal(seed=0, index=2)


@cache
def fit() -> FittedBody:
    body = fit_animal(ANIMAL.image_hw, ANIMAL.keypoints_2d, K=ANIMAL.K, species="dog")
    assert isinstance(body, FittedBody)
    return body


@cache
def label() -> CuboidLabel:
    outcome = label_animal(
        ANIMAL.image_hw,
        ANIMAL.keypoints_2d,
        K=ANIMAL.K,
        species="dog",
        sample_id="a.jpg",
        body="fit",
    )
    assert isinstance(outcome, CuboidLabel)
    return outcome


def own(one: CuboidLabel) -> FitParameters:
    assert one.fit is not None
    return one.fit


def test_a_label_keeps_what_poses_its_body_again() -> None:
    assert (own(label()).body, own(label()).vocabulary) == ("quadruped:dog", "animal3d26")
    posed = fitted_vertices(own(label()))
    assert np.abs(posed - fit().vertices).max() < 1e-6
    in_camera = posed @ label().R.numpy().T + label().t.numpy()
    assert np.abs(in_camera - fit().vertices_cam).max() < 1e-6


def test_a_cached_label_keeps_it_too() -> None:
    back = unpacked_outcome(packed_outcome(label()))
    assert isinstance(back, CuboidLabel)
    assert np.array_equal(fitted_vertices(own(back)), fit().vertices)
    assert own(back).digest == load_quadruped().digest


def test_labels_json_keeps_it_too(tmp_path: Path) -> None:
    metric = in_metres(label(), 0.5, "user")
    row = animal_row(metric, image="a.jpg", animal=0, category="dog")
    write_labels_json(
        tmp_path / "labels.json", LabelFile(body="fit", config={}, animals=[row], rejected=[])
    )
    (back,) = read_labels_json(tmp_path / "labels.json").animals
    assert isinstance(back.fit, FitRow)
    assert back.fit == row.fit
    vertices = fitted_vertices(back.fit.parameters)
    in_camera = 0.5 * vertices @ np.array(back.R).T + np.array(back.t)
    assert np.abs(in_camera - 0.5 * fit().vertices_cam).max() < 1e-6


def test_a_label_without_a_fit_has_no_such_field(tmp_path: Path) -> None:
    given = label_animal(
        ANIMAL.image_hw,
        vertices=ANIMAL.vertices,
        template=ANIMAL.model,
        K=ANIMAL.K,
        pose=(ANIMAL.R, ANIMAL.t),
    )
    assert isinstance(given, CuboidLabel)
    assert given.fit is None
    row = animal_row(given, image="a.jpg", animal=0, category="dog")
    write_labels_json(
        tmp_path / "labels.json", LabelFile(body="dog", config={}, animals=[row], rejected=[])
    )
    assert '"fit"' not in (tmp_path / "labels.json").read_text()


@pytest.mark.parametrize(
    ("body", "remedy"), [("model", "the file that it was fitted with"), ("quadruped", "version")]
)
def test_parameters_of_another_body_are_refused(body: str, remedy: str) -> None:
    other = replace(own(label()), body=body, digest="0" * 32)
    with pytest.raises(ConfigError, match=remedy):
        fitted_vertices(other)


def test_the_digest_is_the_contents() -> None:
    model = load_quadruped()
    same = replace(model, v_template=model.v_template.clone())
    moved = replace(model, v_template=model.v_template + 1e-9)
    renamed = replace(model, landmarks=dict(reversed(list(model.landmarks.items()))))
    assert same.digest == model.digest
    assert len({model.digest, moved.digest, renamed.digest}) == 3
