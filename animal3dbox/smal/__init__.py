"""Bodies of the SMAL family: models and their files, keypoints, and the embedded quadruped.

The names below are loaded when first used (PEP 562).
"""

from typing import TYPE_CHECKING

from animal3dbox.lazy_exports import lazy_exports

if TYPE_CHECKING:
    from animal3dbox.smal.files.model_files import ShapeFamily as ShapeFamily
    from animal3dbox.smal.files.model_files import load_family as load_family
    from animal3dbox.smal.files.model_files import load_model as load_model
    from animal3dbox.smal.files.model_files import load_smal as load_smal
    from animal3dbox.smal.files.model_files import load_symmetry as load_symmetry
    from animal3dbox.smal.files.pickle_writer import write_smal_pickle as write_smal_pickle
    from animal3dbox.smal.files.safetensors_file import load_safetensors as load_safetensors
    from animal3dbox.smal.files.safetensors_file import save_safetensors as save_safetensors
    from animal3dbox.smal.keypoints.vocabularies import VOCABULARIES as VOCABULARIES
    from animal3dbox.smal.keypoints.vocabularies import find_vocabulary as find_vocabulary
    from animal3dbox.smal.keypoints.vocabulary import Vocabulary as Vocabulary
    from animal3dbox.smal.keypoints.vocabulary import load_vocabulary as load_vocabulary
    from animal3dbox.smal.keypoints.vocabulary import vocabulary_from_names as vocabulary_from_names
    from animal3dbox.smal.keypoints.vocabulary_match import NameMatch as NameMatch
    from animal3dbox.smal.keypoints.vocabulary_match import match_by_name as match_by_name
    from animal3dbox.smal.linear_blend_skinning import PosedBody as PosedBody
    from animal3dbox.smal.model import SPINE_JOINTS as SPINE_JOINTS
    from animal3dbox.smal.model import SmalModel as SmalModel
    from animal3dbox.smal.model import trunk_rotation as trunk_rotation
    from animal3dbox.smal.parameters import SmalParameters as SmalParameters
    from animal3dbox.smal.parameters import posed_bodies as posed_bodies
    from animal3dbox.smal.parameters import posed_body as posed_body
    from animal3dbox.smal.quadruped.joint_limits import joint_limits as joint_limits
    from animal3dbox.smal.quadruped.poses import POSES as POSES
    from animal3dbox.smal.quadruped.poses import ground_trans as ground_trans
    from animal3dbox.smal.quadruped.poses import named_pose as named_pose
    from animal3dbox.smal.quadruped.poses import random_pose as random_pose
    from animal3dbox.smal.quadruped.preset_bodies import QuadrupedNames as QuadrupedNames
    from animal3dbox.smal.quadruped.preset_bodies import load_quadruped as load_quadruped
    from animal3dbox.smal.quadruped.preset_bodies import measure_betas as measure_betas
    from animal3dbox.smal.quadruped.preset_bodies import preset_betas as preset_betas
    from animal3dbox.smal.quadruped.preset_bodies import quadruped_names as quadruped_names

__getattr__, __dir__, __all__ = lazy_exports(
    __name__,
    {
        "files.model_files": (
            "ShapeFamily",
            "load_family",
            "load_model",
            "load_smal",
            "load_symmetry",
        ),
        "files.pickle_writer": ("write_smal_pickle",),
        "files.safetensors_file": ("load_safetensors", "save_safetensors"),
        "keypoints.vocabularies": ("VOCABULARIES", "find_vocabulary"),
        "keypoints.vocabulary": ("Vocabulary", "load_vocabulary", "vocabulary_from_names"),
        "keypoints.vocabulary_match": ("NameMatch", "match_by_name"),
        "linear_blend_skinning": ("PosedBody",),
        "model": ("SPINE_JOINTS", "SmalModel", "trunk_rotation"),
        "parameters": ("SmalParameters", "posed_bodies", "posed_body"),
        "quadruped.joint_limits": ("joint_limits",),
        "quadruped.poses": ("POSES", "ground_trans", "named_pose", "random_pose"),
        "quadruped.preset_bodies": (
            "QuadrupedNames",
            "load_quadruped",
            "measure_betas",
            "preset_betas",
            "quadruped_names",
        ),
    },
)
