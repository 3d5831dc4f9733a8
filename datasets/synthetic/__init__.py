"""A synthetic world with exact truth, the faults of its annotations, and writers of its datasets.

`world` makes the pictures, `scenes` the truth, `annotation` and `faults` what a dataset would say;
`synthetic_set` is a whole dataset in memory, and the writers put one on the disk.

The names below are loaded when first used (PEP 562).
"""

from typing import TYPE_CHECKING

from animal3dbox.lazy_exports import lazy_exports

if TYPE_CHECKING:
    from animal3dbox.datasets.synthetic.animal3d_writer import write_animal3d as write_animal3d
    from animal3dbox.datasets.synthetic.faults import FaultConfig as FaultConfig
    from animal3dbox.datasets.synthetic.scenes import SyntheticAnimal as SyntheticAnimal
    from animal3dbox.datasets.synthetic.scenes import SyntheticScene as SyntheticScene
    from animal3dbox.datasets.synthetic.scenes import synthetic_animal as synthetic_animal
    from animal3dbox.datasets.synthetic.scenes import synthetic_scene as synthetic_scene
    from animal3dbox.datasets.synthetic.stanfordextra_writer import (
        write_stanfordextra as write_stanfordextra,
    )
    from animal3dbox.datasets.synthetic.synthetic_set import SyntheticSample as SyntheticSample
    from animal3dbox.datasets.synthetic.synthetic_set import SyntheticSet as SyntheticSet
    from animal3dbox.datasets.synthetic.synthetic_set import animal3d_world as animal3d_world
    from animal3dbox.datasets.synthetic.world.config import WorldConfig as WorldConfig

__getattr__, __dir__, __all__ = lazy_exports(
    __name__,
    {
        "animal3d_writer": ("write_animal3d",),
        "faults": ("FaultConfig",),
        "scenes": (
            "SyntheticAnimal",
            "SyntheticScene",
            "synthetic_animal",
            "synthetic_scene",
        ),
        "stanfordextra_writer": ("write_stanfordextra",),
        "synthetic_set": (
            "SyntheticSample",
            "SyntheticSet",
            "animal3d_world",
        ),
        "world.config": ("WorldConfig",),
    },
)
