"""The outline of a fitted body in overlays and gallery."""

from dataclasses import replace
from functools import cache
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch
from numpy.typing import NDArray
from PIL import Image

from animal3dbox import CuboidLabel, LabelConfig, label_animal
from animal3dbox.datasets.labelling.scale import in_metres
from animal3dbox.datasets.synthetic.scenes import synthetic_animal
from animal3dbox.errors import ConfigError
from animal3dbox.geometry.rasterizer import silhouette
from animal3dbox.labels.fit.fit import fit_animal
from animal3dbox.labels.fit.fitted_body import FittedBody
from animal3dbox.report.fitted_outline import OUTLINE, draw_fitted_outline
from animal3dbox.report.overlay import draw_label, enlarged
from animal3dbox.report.run import write_run
from animal3dbox.report.run_rows import Labelled
from animal3dbox.smal.quadruped.preset_bodies import load_quadruped

ANIMAL = synthetic_animal(seed=0, index=2)
GREY = np.full((*ANIMAL.image_hw, 3), 128, dtype=np.uint8)


@cache
def label() -> CuboidLabel:
    outcome = label_animal(
        ANIMAL.image_hw, ANIMAL.keypoints_2d, K=ANIMAL.K, sample_id="a.jpg", body="fit"
    )
    assert isinstance(outcome, CuboidLabel)
    return outcome


def rim() -> NDArray[np.bool_]:
    """The pixels within three of the edge of the fitted body's silhouette."""
    fit = fit_animal(ANIMAL.image_hw, ANIMAL.keypoints_2d, K=ANIMAL.K)
    assert isinstance(fit, FittedBody)
    vertices, faces = torch.from_numpy(fit.vertices_cam), load_quadruped().faces
    mask = silhouette(vertices, faces, ANIMAL.K, ANIMAL.image_hw).numpy().astype(np.uint8)
    box = np.ones((7, 7), dtype=np.uint8)
    return np.asarray(cv2.dilate(mask, box) != cv2.erode(mask, box))


def white(canvas: NDArray[np.uint8]) -> NDArray[np.bool_]:
    return np.asarray((canvas > OUTLINE[0] - 55).all(-1))


@pytest.mark.parametrize("metres", [None, 0.4])
def test_the_outline_is_the_silhouettes_whatever_the_labels_unit(metres: float | None) -> None:
    canvas, near = GREY.copy(), rim()
    one = label() if metres is None else in_metres(label(), metres, "user")
    draw_fitted_outline(canvas, one, load_quadruped())
    assert white(canvas).sum() > 300
    assert not white(canvas)[~near].any()
    # All round it: every tile of the rim has some of the line
    for rows in np.array_split(np.arange(near.shape[0]), 12):
        for columns in np.array_split(np.arange(near.shape[1]), 16):
            tile = np.ix_(rows, columns)
            assert near[tile].sum() < 90 or white(canvas)[tile].any()


def test_an_enlarged_picture_has_it_in_its_place() -> None:
    small, factor = enlarged(GREY[::4, ::4].copy())
    K = ANIMAL.K.clone()
    K[:2] /= 4
    K[:2, 2] += 0.5 / 4 - 0.5
    little = replace(label().with_fields(K=K), image_hw=GREY[::4, ::4].shape[:2])
    draw_fitted_outline(small, little, load_quadruped(), factor=factor)
    rows, columns = np.nonzero(white(small))
    own_rows, own_columns = np.nonzero(rim())
    for ends, wanted in ((columns, own_columns), (rows, own_rows)):
        by_factor = (np.array([wanted.min() + 3, wanted.max() - 3]) + 0.5) * factor / 4 - 0.5
        assert np.abs(np.array([ends.min(), ends.max()]) - by_factor).max() < 4


def test_other_bodies_and_no_model_draw_nothing() -> None:
    given = replace(label(), fit=None)
    canvas = GREY.copy()
    draw_fitted_outline(canvas, given, load_quadruped())
    assert np.array_equal(canvas, GREY)
    plain = draw_label(GREY, label())
    assert np.array_equal(plain, draw_label(GREY, given, load_quadruped()))
    assert not np.array_equal(plain, draw_label(GREY, label(), load_quadruped()))


def test_a_fit_of_another_model_is_refused() -> None:
    fit = label().fit
    assert fit is not None
    other = replace(label(), fit=replace(fit, digest="0"))
    with pytest.raises(ConfigError, match="digest"):
        draw_fitted_outline(GREY.copy(), other, load_quadruped())


def test_a_runs_pictures_have_it(tmp_path: Path) -> None:
    write_run(
        tmp_path,
        [Labelled(label(), "a.jpg", "dog", GREY)],
        source="set",
        body="fit",
        config=LabelConfig(),
        fitted=load_quadruped(),
    )
    overlay = np.asarray(Image.open(tmp_path / "overlays" / "a.png"))
    assert np.array_equal(overlay, draw_label(GREY, label(), load_quadruped()))
