"""A model goes to other processes as the path and digest of its file, and is loaded there once."""

import copy
import pickle
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest
import torch

from animal3dbox.datasets.bodies.fitted import FittedBodies
from animal3dbox.datasets.bodies.sources import ParametersBody, preset_body
from animal3dbox.errors import ModelFileError
from animal3dbox.smal import (
    SmalModel,
    load_model,
    load_quadruped,
    model_origin,
    save_safetensors,
    write_smal_pickle,
)

SMALL = 2000
"""Bytes that a path and a digest take at most; the quadruped's arrays take 50 MB."""


@pytest.fixture
def another_process() -> Iterator[None]:
    """What a process knows that no model has been loaded in; this one knows its own afterwards."""
    known = dict(model_origin._KNOWN)
    yield
    model_origin._KNOWN.update(known)


def forget() -> None:
    """Forget all models, as another process never knew them."""
    model_origin._KNOWN.clear()
    model_origin._loaded.cache_clear()


@pytest.fixture(params=["model.safetensors", "model.pkl"])
def file(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    path: Path = tmp_path / request.param
    write = save_safetensors if path.suffix == ".safetensors" else write_smal_pickle
    write(load_quadruped(), path)
    return path


def test_the_quadruped_is_the_same_object_wherever_it_is_sent() -> None:
    sent = pickle.dumps(load_quadruped())
    assert len(sent) < SMALL
    assert pickle.loads(sent) is load_quadruped()
    assert copy.deepcopy(load_quadruped()) is load_quadruped()


def test_bodies_take_their_model_along_as_its_origin(file: Path) -> None:
    model = load_model(file, None if file.suffix == ".safetensors" else load_quadruped().landmarks)
    for source in (preset_body("dog"), FittedBodies(model), ParametersBody(model, {})):
        sent = pickle.dumps(source)
        assert len(sent) < 2 * SMALL
        assert pickle.loads(sent).model is source.model


def test_another_process_loads_a_file_once(file: Path, another_process: None) -> None:
    model = load_model(file)
    sent = pickle.dumps(model)
    forget()
    received: SmalModel = pickle.loads(sent)
    assert len(sent) < SMALL
    assert received is not model
    assert received.digest == model.digest
    assert (received.landmarks, received.joint_names) == (model.landmarks, model.joint_names)
    assert pickle.loads(sent) is received


def test_a_file_that_is_another_one_by_now_is_refused(file: Path, another_process: None) -> None:
    sent = pickle.dumps(load_model(file))
    forget()
    file.write_bytes(file.read_bytes() + b" ")
    with pytest.raises(ModelFileError, match="is not the file any more"):
        pickle.loads(sent)
    file.unlink()
    with pytest.raises(ModelFileError, match="cannot be read"):
        pickle.loads(sent)


def test_a_model_that_was_changed_takes_its_arrays_along() -> None:
    small = load_quadruped()
    for changed in (small.to(torch.float32), replace(small, joint_names=small.joint_names[::-1])):
        sent = pickle.dumps(changed)
        assert len(sent) > 10**6
        received = pickle.loads(sent)
        assert received.digest == changed.digest
        assert received.v_template.dtype == changed.v_template.dtype
