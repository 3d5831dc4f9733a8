"""Models written as SMAL pickles come back as they were."""

import subprocess
import sys
from pathlib import Path

import torch

from animal3dbox.smal.files.model_files import load_smal
from animal3dbox.smal.files.pickle_writer import write_smal_pickle
from animal3dbox.smal.keypoints.smal_topology import SMAL_JOINTS
from animal3dbox.smal.quadruped.preset_bodies import load_quadruped


def test_a_model_written_as_a_pickle_is_read_back_to_the_bit(tmp_path: Path) -> None:
    model, path = load_quadruped(), tmp_path / "body.pkl"
    write_smal_pickle(model, path)
    again = load_smal(path, landmarks=model.landmarks)
    for name in ("v_template", "faces", "shapedirs", "posedirs", "J_regressor", "weights"):
        assert torch.equal(getattr(again, name), getattr(model, name)), name
    assert again.parents == model.parents
    assert again.joint_names == SMAL_JOINTS
    assert again.landmarks == model.landmarks
    assert load_smal(path).landmarks == {}  # the pickle has no place for them


def test_pythons_own_unpickler_needs_nothing_but_chumpy_for_it(tmp_path: Path) -> None:
    model, path = load_quadruped(), tmp_path / "body.pkl"
    write_smal_pickle(model, path)
    # A stand-in for chumpy; warnings because NumPy 2 has moved numpy.core
    code = f"""
import pickle, sys, types, warnings
warnings.simplefilter("ignore")

ch = types.ModuleType("chumpy.ch")
ch.Ch = type("Ch", (), {{}})
sys.modules.update({{"chumpy": types.ModuleType("chumpy"), "chumpy.ch": ch}})
with open({str(path)!r}, "rb") as file:
    content = pickle.load(file, encoding="latin1")
print(content["v_template"].x.shape, content["f"].dtype, content["J_regressor"].shape, end=" ")
print(content["kintree_table"][0, 0], content["bs_type"])
"""
    ran = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert (
        ran.stdout.split("\n")[0]
        == f"({model.vertex_count}, 3) uint32 (35, {model.vertex_count}) 4294967295 lrotmin"
    )
