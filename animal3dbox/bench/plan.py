"""The plan of a benchmark: its splits, each a world of a seed, as the committed seed file says."""

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, fields
from importlib import resources
from typing import Any

from animal3dbox.bench.editions import EDITIONS, Edition
from animal3dbox.datasets.storage.fingerprint import content_digest
from animal3dbox.datasets.synthetic.faults import FaultConfig
from animal3dbox.datasets.synthetic.world.config import WorldConfig
from animal3dbox.errors import ConfigError

SEED_FILE = "bench-v1.toml"
"""The committed seed file, in assets/."""


@dataclass(frozen=True, kw_only=True)
class SplitPlan:
    """One split: the first scenes of a seed's world, and what is wrong with its keypoints.

    Attributes:
        name: such as "test-id".
        seed: of the world.
        images: number of scenes.
        world: the world's dials.
        faults: of the keypoints that the track +keypoints is given.

    Example:
        >>> split = bench_plan("small").split("test-species")
        >>> split.images, split.world.presets
        (30, ('deer', 'lion'))
    """

    name: str
    seed: int
    images: int
    world: WorldConfig
    faults: FaultConfig

    def image_name(self, index: int) -> str:
        """The path of an image below the benchmark's folder."""
        return f"images/{self.name}/{index:06d}.png"


@dataclass(frozen=True, kw_only=True)
class BenchPlan:
    """All splits of one edition of a benchmark.

    Attributes:
        version: the benchmark's, such as "bench-v1".
        edition: of EDITIONS.
        splits: in the seed file's order.

    Example:
        >>> [split.name for split in bench_plan("full").splits][:3]
        ['train', 'val', 'test-id']
    """

    version: str
    edition: Edition
    splits: tuple[SplitPlan, ...]

    @property
    def digest(self) -> str:
        """Names everything that the plan says, in hexadecimal digits.

        Of a world and its faults that is what differs from their defaults, so that a dial which is
        added later does not rename a plan that leaves it alone.
        """
        splits = [
            (split.name, split.seed, split.images, _turned(split.world), _turned(split.faults))
            for split in self.splits
        ]
        return content_digest((self.version, self.edition, splits)).hex()

    def split(self, name: str) -> SplitPlan:
        """The split of a name.

        Raises:
            ConfigError: there is none.

        """
        for split in self.splits:
            if split.name == name:
                return split
        names = ", ".join(split.name for split in self.splits)
        raise ConfigError(f"the splits of {self.version} are {names}; got {name!r}")


def bench_plan(edition: Edition) -> BenchPlan:
    """The plan of bench-v1, from the committed seed file.

    Args:
        edition: "full", or "small" of 300 images.

    Raises:
        ConfigError: there is no such edition.

    Example:
        >>> sum(split.images for split in bench_plan("small").splits)
        300
    """
    if edition not in EDITIONS:
        raise ConfigError(f"editions are {', '.join(EDITIONS)}; got {edition!r}")
    file = resources.files("animal3dbox.bench").joinpath("assets", SEED_FILE)
    content = tomllib.loads(file.read_text())
    faults = FaultConfig(**content["keypoints"])
    shared = {"image_hw": content["image_hw"], **content["world"]}
    splits = tuple(
        SplitPlan(
            name=name,
            seed=split["seed"],
            images=split["images"][edition],
            world=_world({**shared, **split.get("world", {})}),
            faults=faults,
        )
        for name, split in content["splits"].items()
    )
    return BenchPlan(version=content["version"], edition=edition, splits=splits)


def _turned(dials: WorldConfig | FaultConfig) -> dict[str, Any]:
    """The dials that are not as they are by default, in alphabetical order."""
    default = type(dials)()
    names = sorted(field.name for field in fields(dials))
    values = {name: getattr(dials, name) for name in names}
    return {name: value for name, value in values.items() if value != getattr(default, name)}


def _world(dials: Mapping[str, Any]) -> WorldConfig:
    """The world of dials as TOML has them, whose ranges and names are lists there."""
    values: dict[str, Any] = {
        name: tuple(dial) if isinstance(dial, list) else dial for name, dial in dials.items()
    }
    return WorldConfig(**values)
