"""The dials of a foreign world, and the two mixes of it: one to tune with, one to report."""

from dataclasses import dataclass, field
from typing import Literal

from animal3dbox.datasets.synthetic.faults import FaultConfig
from animal3dbox.datasets.synthetic.world.config import WorldConfig
from animal3dbox.errors import ConfigError

Shoulders = Literal["own", "level"]
Surface = Literal["own", "parts"]

STANDING_POSES = ("stand", "walk", "head_turned", "graze", "tail_up")
OTHER_POSES = ("trot", "run", "sit", "lie", "rear", "curl", "random")
ALONE = WorldConfig(animals=(1, 1), occluded=0.0, truncated=0.0)


@dataclass(frozen=True)
class ForeignConfig:
    """The dials of a foreign world.

    Attributes:
        world: species, pictures and cameras; its poses, animals and things are not used.
        faults: of the keypoints and the mask; joint_deg turns the joints of the fitted body.
        standing: part of the animals in one of STANDING_POSES; the others are in OTHER_POSES.
        poses: the only poses, of STANDING_POSES and OTHER_POSES; none: as `standing` says.
        joints_deg: standard deviation of a further turn of every joint but the root about each
            axis, whatever the joints' limits.
        lying: part of the animals that lie on a side, whatever their pose.
        proportions: spread of the trunk's, legs', neck's and head's measures beyond the presets':
            0 for none, 1 for logarithms with the standard deviations of bodies.PART_SPREAD.
        individual: part of the spread of shapes and proportions by which each animal differs from
            its class, the animals of a species in a dataset; the class has them in full. 1: there
            are no classes, every animal has a shape and proportions of its own.
        places: standard deviation of the keypoints' places from the quadruped's, as a part of the
            trunk's length; drawn once a dataset, mirrored left and right.
        places_of_animal: the same, drawn for each animal.
        shoulders: "level" puts the shoulders at the height of the tail's base in the template, as
            SMAL's keypoint groups lie; "own" leaves them.
        surface: "own" is the quadruped's, stretched; "parts" is of another topology, a convex part
            a bone (parts.py).
        cell: side of the cells in which vertices are merged to another mesh, as a part of the
            body's diagonal; 0 keeps the mesh.
        mask_jitter_px: standard deviation of the mask's outline from the true one.
        mask_holes: part of the masks with holes.
        occluded: part of the animals before which something stands: it cuts the mask, and
            keypoints behind it are not marked.
        stature: standard deviation of the logarithm of each fitted measure from the body's own;
            0: the fitted body has the animal's shape.

    Example:
        >>> ForeignConfig(standing=0.0).places
        0.08
    """

    world: WorldConfig = ALONE
    faults: FaultConfig = field(default_factory=lambda: FaultConfig(noise_px=2.0))
    standing: float = 0.5
    poses: tuple[str, ...] = ()
    joints_deg: float = 0.0
    lying: float = 0.0
    proportions: float = 1.0
    individual: float = 1.0
    places: float = 0.08
    places_of_animal: float = 0.02
    shoulders: Shoulders = "own"
    surface: Surface = "own"
    cell: float = 0.0
    mask_jitter_px: float = 1.0
    mask_holes: float = 0.0
    occluded: float = 0.0
    stature: float = 0.0

    def __post_init__(self) -> None:
        limits = {
            "standing": (0, 1),
            "joints_deg": (0, 45),
            "lying": (0, 1),
            "proportions": (0, 3),
            "individual": (0, 1),
            "places": (0, 0.5),
            "places_of_animal": (0, 0.5),
            "cell": (0, 0.2),
            "mask_jitter_px": (0, 20),
            "mask_holes": (0, 1),
            "occluded": (0, 1),
            "stature": (0, 1),
        }
        for name, (low, high) in limits.items():
            if not low <= getattr(self, name) <= high:
                raise ConfigError(
                    f"{name} must lie within {low} and {high}, got {getattr(self, name)}"
                )
        choices = (*STANDING_POSES, *OTHER_POSES)
        if unknown := [pose for pose in self.poses if pose not in choices]:
            raise ConfigError(f"poses must be of {', '.join(choices)}, got {', '.join(unknown)}")
        if self.shoulders not in ("own", "level"):
            raise ConfigError(f"shoulders must be 'own' or 'level', got {self.shoulders!r}")
        if self.surface not in ("own", "parts"):
            raise ConfigError(f"surface must be 'own' or 'parts', got {self.surface!r}")
