"""Which keypoints of a body a camera sees."""

from collections.abc import Sequence

import torch
from torch import Tensor

from animal3dbox.geometry.visible_surface import visible_vertices
from animal3dbox.smal.keypoints.vocabulary import Groups, Vocabulary


def visible_keypoints(
    vocabulary: Vocabulary,
    groups: Groups,
    vertices_cam: Tensor,
    faces: Tensor,
    *,
    K: Tensor,
    image_hw: tuple[int, int],
    body: tuple[int, int] | None = None,
) -> Tensor:
    """Which keypoints (J,) bool the camera sees: those of whose vertices it sees any.

    See visible_vertices.

    A group's mean lies inside the flesh, so its own ray would always be blocked.

    Args:
        vocabulary: the keypoints.
        groups: the body's places, as vocabulary.on_body takes them.
        vertices_cam: (V, 3) of the body, or of a whole scene.
        faces: (F, 3) likewise.
        K: (3, 3) in px.
        image_hw: height and width.
        body: first and last + 1 of the body's vertices in a scene; None: all are its.

    Example:
        >>> from animal3dbox.datasets.synthetic import synthetic_animal
        >>> from animal3dbox.labels import visible_keypoints
        >>> animal = synthetic_animal(seed=0, index=2)
        >>> seen = visible_keypoints(
        ...     animal.vocabulary, animal.model.landmark_groups, animal.vertices_cam,
        ...     animal.model.faces, K=animal.K, image_hw=animal.image_hw)
        >>> names = animal.vocabulary.keypoints
        >>> [name for name, is_seen in zip(names, seen, strict=True) if is_seen][:3]
        ['left_eye', 'right_eye', 'left_front_paw']
    """
    first, stop = body or (0, len(vertices_cam))
    places = [
        [] if place is None else [first + i for i in _ids(place)]
        for place in vocabulary.places(groups, stop - first)
    ]
    asked = torch.tensor(sorted({i for ids in places for i in ids}), dtype=torch.int64)
    seen = set(asked[visible_vertices(vertices_cam, faces, K, image_hw, ids=asked)].tolist())
    return torch.tensor([any(i in seen for i in ids) for ids in places])


def _ids(place: Sequence[int] | Tensor) -> list[int]:
    return place.nonzero()[:, 0].tolist() if isinstance(place, Tensor) else list(place)
