"""Vertices that no face uses count for nothing."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch
from animals import IMAGE_HW, K, camera_round, keypoints_seen, toy_landmarks, toy_mesh
from torch import Tensor

from animal3dbox import CuboidLabel, LabelConfig, label_animal
from animal3dbox.datasets.synthetic import synthetic_animal
from animal3dbox.errors import SampleError
from animal3dbox.geometry.rasterizer import silhouette
from animal3dbox.labels.config import Axes, Method
from animal3dbox.smal.quadruped.preset_bodies import load_quadruped

MESH, FACES = toy_mesh()
FAR = torch.tensor([[50.0, 50.0, 50.0], [-30.0, 2.0, 1.0]], dtype=torch.float64)
VIEW = camera_round(70, 12)


def labelled(config: LabelConfig | None = None, **arguments: Any) -> CuboidLabel:
    outcome = label_animal(config=config, **arguments)
    assert isinstance(outcome, CuboidLabel), outcome
    return outcome


def toy_arguments() -> dict[str, Any]:
    """The toy animal with keypoints, a mask and no known camera."""
    R, t = VIEW
    return {
        "image_hw": IMAGE_HW,
        "keypoints_2d": keypoints_seen(*VIEW),
        "keypoints_3d": toy_landmarks(),
        "faces": FACES,
        "K": K,
        "mask": silhouette(MESH @ R.mT + t, FACES, K, IMAGE_HW),
    }


@pytest.mark.parametrize("method", ["default", "paper", "basic"])
@pytest.mark.parametrize("axes", ["default", "landmarks", "pca"])
@pytest.mark.parametrize("first", [True, False])
def test_loose_vertices_change_no_number_of_a_label(
    method: Method, axes: Axes, first: bool
) -> None:
    config, arguments = LabelConfig(method=method, axes=axes), toy_arguments()
    clean = labelled(config, vertices=MESH, **arguments)
    if first:
        arguments["faces"] = FACES + len(FAR)
    vertices = torch.cat((FAR, MESH) if first else (MESH, FAR))
    loose = labelled(config, vertices=vertices, **arguments)
    assert loose.row.tobytes() == clean.row.tobytes()
    warning = f"2 of {len(vertices)} vertices count for nothing: no face uses them"
    assert sorted(loose.quality.warnings) == sorted((*clean.quality.warnings, warning))
    assert replace(loose.quality, warnings=()) == replace(clean.quality, warnings=())


def test_without_a_mask_loose_vertices_change_no_flat_box() -> None:
    arguments = toy_arguments() | {"mask": None, "pose": VIEW, "keypoints_2d": None}
    clean = labelled(vertices=MESH, **arguments)
    loose = labelled(vertices=torch.cat((MESH, FAR)), **arguments)
    assert loose.row.tobytes() == clean.row.tobytes()


def cut_tail(far: Tensor | None = None) -> tuple[dict[str, Any], np.ndarray]:
    """A quadruped whose tail's faces were dropped and its vertices kept, and who is still used."""
    animal, model = synthetic_animal(seed=0, index=2), load_quadruped()
    faces = model.without_tail_faces()
    used = np.zeros(model.vertex_count, dtype=np.bool_)
    used[faces.numpy()] = True
    vertices = animal.vertices.clone()
    if far is not None:
        vertices[torch.from_numpy(~used)] = far
    arguments: Mapping[str, Any] = {
        "image_hw": animal.image_hw,
        "keypoints_2d": animal.keypoints_2d,
        "vertices": vertices,
        "faces": faces,
        "K": animal.K,
        "pose": (animal.R, animal.t),
    }
    return dict(arguments), used


@pytest.mark.parametrize("far", [None, FAR[0]])
@pytest.mark.parametrize("tail", ["keep", "drop"])
def test_a_cut_tail_leaves_the_axes_of_the_template_and_a_box_of_what_the_faces_show(
    far: Tensor | None, tail: Any
) -> None:
    model = load_quadruped()
    arguments, used = cut_tail(far)
    whole = labelled(template=model, **(arguments | {"faces": model.faces, **cut_tail()[0]}))
    cut = labelled(LabelConfig(tail=tail), template=model, **arguments)
    assert cut.quality.orientation_rule == "torso vertices on the template"
    rotation = cut.cuboid_mesh.rotation.numpy()
    np.testing.assert_allclose(rotation, whole.cuboid_mesh.rotation.numpy(), atol=1e-9)
    if tail == "drop":
        used[model.tail_vertices.numpy()] = False
    shown = np.asarray(arguments["vertices"])[used] @ rotation
    np.testing.assert_allclose(cut.size.numpy(), np.ptp(shown, axis=0), rtol=1e-5)


def test_a_landmark_of_loose_vertices_alone_is_none_that_the_body_has() -> None:
    model = load_quadruped()
    arguments, used = cut_tail(FAR[0])
    names = list(model.landmarks)
    gone = [not used[list(model.landmarks[name])].any() for name in names]
    assert gone[names.index("tail_tip")]
    seen = arguments["keypoints_2d"][:, 2].numpy() > 0
    label = labelled(template=model, **arguments)
    assert label.quality.n_keypoints == int((seen & ~np.array(gone)).sum())
    assert label.quality.reprojection_error_px is not None
    assert label.quality.reprojection_error_px < 5


def test_a_template_with_loose_vertices_of_its_own_tells_which_count() -> None:
    model = load_quadruped()
    cut = replace(model, faces=model.without_tail_faces())
    arguments, _ = cut_tail()
    del arguments["faces"]
    label = labelled(template=cut, **arguments)
    with_faces = labelled(template=cut, faces=cut.faces, **arguments)
    assert label.size.tolist() == with_faces.size.tolist()
    assert "count for nothing" in label.quality.warnings[0]


def test_a_body_that_lacks_its_torso_gets_its_axes_from_landmarks() -> None:
    model = load_quadruped()
    arguments, _ = cut_tail()
    torso = torch.isin(model.faces, model.torso_vertices).any(1)
    label = labelled(template=model, **(arguments | {"faces": model.faces[~torso]}))
    assert label.quality.orientation_rule.startswith("trunk line")


def test_faces_of_three_vertices_are_no_body() -> None:
    arguments = toy_arguments() | {"faces": [[0, 1, 2]]}
    with pytest.raises(SampleError, match=r"dog: faces: use 3 of the \d+ vertices"):
        label_animal(vertices=MESH, sample_id="dog", **arguments)
