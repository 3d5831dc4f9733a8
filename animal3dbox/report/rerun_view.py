"""Images, cameras and boxes as a recording of Rerun, a viewer of 3D scenes (extra `rerun`)."""

from collections.abc import Iterable
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import torch

from animal3dbox.datasets.labelling.skipped import Skipped
from animal3dbox.errors import ConfigError, SampleError
from animal3dbox.files import write_whole
from animal3dbox.geometry.cuboid import EDGES, FACES, Cuboid
from animal3dbox.report.cuboid_pen import BACK, FRONT
from animal3dbox.report.inset import Picture
from animal3dbox.report.target_boxes import Fields, checked_field, cuboids_of, picture_of

TIMELINE = "image"
"""The viewer's slider goes through the images in their order."""
SIDES = (150, 150, 150)
"""RGB of the edges that are neither of the front nor of the back."""


def write_rerun(
    path: Path | str, samples: Iterable[tuple[torch.Tensor | Picture, Fields] | Skipped]
) -> int:
    """Write images, cameras and boxes into a .rrd file, which `rerun FILE` opens.

    The world is the camera's frame (x right, y down, z forward), so that each image hangs before
    its own camera. Boxes are drawn with a green front and a blue back, as in overlays, and an arrow
    from the centre through the front.

    Args:
        path: the file to write, replaced if it is there.
        samples: pairs of an image, (3, H, W) or (H, W, 3) uint8 RGB, and a target with `center`
            (N, 3), `rotation` (N, 3, 3), `size` (N, 3) and `K` (3, 3), such as a Dataset gives.
            What a Dataset skipped has no target and is left out.

    Returns:
        How many images were written.

    Raises:
        ConfigError: Rerun is not installed.
        SampleError: a target lacks a field, or has it in another shape.

    Example:
        >>> from animal3dbox.datasets import SyntheticDataset
        >>> from animal3dbox.report import write_rerun
        >>> dataset = SyntheticDataset(2, seed=0, image_hw=(120, 160))
        >>> written = write_rerun("world.rrd", dataset)  # doctest: +SKIP
    """
    rerun = _rerun()
    recording = rerun.RecordingStream("animal3dbox")
    stream = recording.memory_recording()
    recording.log("world", rerun.ViewCoordinates.RDF, static=True)
    usable = (sample for sample in samples if not isinstance(sample, Skipped))
    count = 0
    for count, (image, target) in enumerate(usable, start=1):
        recording.set_time(TIMELINE, sequence=count - 1)
        _log_sample(rerun, recording, picture_of(image), target)
    recording.flush()
    write_whole(Path(path), stream.drain_as_bytes())
    return count


def _rerun() -> Any:
    """The module; it has no types of its own that hold without it."""
    try:
        return import_module("rerun")
    except ImportError as error:
        raise ConfigError("a recording needs Rerun: pip install 'animal3dbox[rerun]'") from error


def _log_sample(rerun: Any, recording: Any, picture: Picture, target: Fields) -> None:
    """Log one image before its camera, and its boxes."""
    image_id = str(target.get("image_id", "target"))
    if "K" not in target:
        raise SampleError(image_id, "target K", "is missing, and the image has no camera without")
    K = checked_field(target, image_id, "target", name="K", spec="3 3")
    cuboids = cuboids_of(target, image_id, "target")
    broken = [number for number, cuboid in enumerate(cuboids) if cuboid is None]
    if broken:
        raise SampleError(image_id, "target center, rotation, size", f"{broken} are no boxes")
    height, width = picture.shape[:2]
    camera = rerun.Pinhole(image_from_camera=K.numpy(), width=width, height=height)
    recording.log("world/camera", camera)
    recording.log("world/camera/image", rerun.Image(picture))
    recording.log("world/image_id", rerun.TextDocument(image_id))
    boxes = [cuboid for cuboid in cuboids if cuboid is not None]
    _log_boxes(rerun, recording, boxes)


def _log_boxes(rerun: Any, recording: Any, cuboids: list[Cuboid]) -> None:
    """Log the edges of boxes, and an arrow through each front; of none: clear the last image's."""
    strips, colors = [], []
    for cuboid in cuboids:
        corners = cuboid.corners().numpy()
        for color, edges in _edges_by_color().items():
            strips += [corners[list(edge)] for edge in edges]
            colors += [color] * len(edges)
    recording.log("world/boxes", rerun.LineStrips3D(strips, colors=colors))
    centers = np.array([cuboid.center.numpy() for cuboid in cuboids]).reshape(-1, 3)
    forward = [(c.rotation[:, 0] * c.size[0] * 0.75).numpy() for c in cuboids]
    vectors = np.array(forward).reshape(-1, 3)
    recording.log("world/fronts", rerun.Arrows3D(origins=centers, vectors=vectors, colors=FRONT))


def _edges_by_color() -> dict[tuple[int, int, int], list[tuple[int, int]]]:
    """RGB -> the edges of a cuboid, as pairs of its corners, that are drawn in it."""
    groups: dict[tuple[int, int, int], list[tuple[int, int]]] = {FRONT: [], BACK: [], SIDES: []}
    for first, second in EDGES:
        of_front, of_back = ({first, second} <= set(FACES[name]) for name in ("front", "back"))
        groups[FRONT if of_front else BACK if of_back else SIDES].append((first, second))
    return groups
