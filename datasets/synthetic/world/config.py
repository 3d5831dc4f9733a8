"""The dials of a synthetic world, and the random numbers of its scenes."""

from dataclasses import dataclass

import numpy as np

from animal3dbox.errors import ConfigError
from animal3dbox.geometry.checks import check_image_hw
from animal3dbox.smal.keypoints.vocabularies import VOCABULARIES
from animal3dbox.smal.keypoints.vocabulary import Vocabulary
from animal3dbox.smal.quadruped.poses import POSES
from animal3dbox.smal.quadruped.preset_bodies import quadruped_names

WORLD_POSES = (*POSES, "tail_up", "random")
"""The quadruped's named poses, a raised tail, and random turns of all joints."""

Range = tuple[float, float]
"""A range: least and greatest."""


@dataclass(frozen=True)
class WorldConfig:
    """The dials of a synthetic world: its animals, cameras and pictures.

    Ranges are (least, greatest).

    Attributes:
        image_hw: height and width of the pictures.
        vocabulary: names of the keypoints.
        presets: the species, taken in turn by the scene's index; all if empty.
        poses: of WORLD_POSES; all if empty.
        animals: number of animals in an image.
        shape_spread: 0 for the plain presets, 1 for individuals as different as breeds are.
        pose_spread: 0 for the plain poses, 1 for joints turned by some degrees more or less.
        occluded: part of the images with things put before the animal; they hide some of it in
            fewer.
        truncated: part of the images whose animal is cut by the frame.
        uav: part of the images taken from above, the others are handheld.
        elevation_deg: of the camera over the horizontal plane at the animal, 10 being the most
            common for handheld ones; those keep below 35, and the ones from above over 25, where
            low ones are more common.
        roll_deg: greatest roll of the camera, to either side.
        focal_px: focal length in pixels, drawn evenly over its logarithm.
        principal_offset: greatest offset of the principal point from the centre, as part of the
            image's sides.
        fill: longer side of the animal's box by the image's side, drawn over its logarithm, large
            ones more often.
        mixed: the species of which some animals have a part beside their own; all if empty.

    Example:
        >>> WorldConfig(image_hw=(120, 160), presets=("dog", "cat")).presets
        ('dog', 'cat')

    """

    image_hw: tuple[int, int] = (480, 640)
    vocabulary: Vocabulary = VOCABULARIES["animal3d26"]
    presets: tuple[str, ...] = ()
    poses: tuple[str, ...] = ()
    animals: tuple[int, int] = (1, 4)
    shape_spread: float = 1.0
    pose_spread: float = 1.0
    occluded: float = 0.5
    truncated: float = 0.15
    uav: float = 0.35
    elevation_deg: Range = (-10.0, 85.0)
    roll_deg: float = 15.0
    focal_px: Range = (500.0, 5000.0)
    principal_offset: float = 0.12
    fill: Range = (0.08, 0.95)
    mixed: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        check_image_hw("image_hw", self.image_hw)
        species = quadruped_names().presets
        for field, choices in (("presets", species), ("poses", WORLD_POSES), ("mixed", species)):
            if unknown := [name for name in getattr(self, field) if name not in choices]:
                raise ConfigError(
                    f"{field} must be of {', '.join(choices)}, got {', '.join(unknown)}"
                )
        limits = {
            "animals": (1, 50),
            "elevation_deg": (-60, 85),
            "focal_px": (1, np.inf),
            "fill": (0.02, 1.0),
            "shape_spread": (0, 3),
            "pose_spread": (0, 3),
            "occluded": (0, 1),
            "truncated": (0, 1),
            "uav": (0, 1),
            "roll_deg": (0, 180),
            "principal_offset": (0, 0.5),
        }
        for field, (low, high) in limits.items():
            value = getattr(self, field)
            least, greatest = value if isinstance(value, tuple) else (value, value)
            if not low <= least <= greatest <= high or not np.isfinite(greatest):
                raise ConfigError(
                    f"{field} must lie within {low} and {high}, the least first, got {value}"
                )


CLEAR = WorldConfig(
    animals=(1, 1),
    shape_spread=0.0,
    pose_spread=0.0,
    occluded=0.0,
    truncated=0.0,
    uav=0.0,
    elevation_deg=(-3.0, 50.0),
    roll_deg=0.0,
    focal_px=(576.0, 1600.0),
    principal_offset=0.0,
    fill=(0.45, 0.75),
    poses=tuple(POSES),
)
"""One whole animal of a plain preset and pose in full view: for examples and first looks."""


def world_generator(seed: int, index: int, purpose: str) -> np.random.Generator:
    """The random numbers of one scene for one purpose.

    Neither the numbers for its other purposes nor other scenes change them.

    Raises:
        ConfigError: seed or index is negative.

    """
    if seed < 0 or index < 0:
        raise ConfigError(f"seed and index must not be negative, got {seed} and {index}")
    return np.random.Generator(
        np.random.PCG64(np.random.SeedSequence((seed, index, *purpose.encode())))
    )


def log_uniform(rng: np.random.Generator, span: Range, bias: float = 1.0) -> float:
    """A random number of a range, drawn over its logarithm.

    Args:
        rng: the random numbers.
        span: the range.
        bias: 1 draws evenly; below 1, greater numbers come more often.

    """
    return float(np.exp(np.log(span[0]) + rng.random() ** bias * np.log(span[1] / span[0])))
