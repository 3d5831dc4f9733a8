"""Keypoints that a regressor wrote in pixels of the animal's crop, told by the animals' meshes.

PRIMA's *_prima26_kpts.npy are such: its code finds keypoints on the crop that its network sees, and
saves them before they are taken anywhere else. Where the crop lies is in no file. A mesh under its
known camera tells whether a file of that name is in pixels of the crop or of the image.
"""

from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from animal3dbox.datasets.bodies.mesh_folder import MeshFolderBodies
from animal3dbox.datasets.readers.animal3d.camera import CLOSE, keypoint_misfit
from animal3dbox.datasets.records import AnimalRecord
from animal3dbox.errors import SampleError

SAMPLES = 12
"""Number of animals whose meshes are read for it."""


def without_crop_keypoints(
    records: Sequence[AnimalRecord], bodies: MeshFolderBodies, of_crop: Collection[str]
) -> tuple[list[AnimalRecord], tuple[SampleError, ...], tuple[str, ...]]:
    """Records whose keypoints are all in pixels of the image, errors of those left with nothing.

    Args:
        records: of a mesh folder.
        bodies: their meshes.
        of_crop: sample ids of those whose keypoints may be in pixels of a crop.

    Returns:
        The records, without the keypoints of a crop; an error of each without a known camera, too;
        and notes, in whole sentences.

    """
    doubtful = [record for record in records if record.sample_id in of_crop]
    if not doubtful:
        return list(records), (), ()
    misfits = list(_misfits(doubtful, bodies))
    if not misfits:
        note = (
            f"{len(doubtful)} animals have PRIMA's keypoints, whose pixels may be those of its"
            " crops: no known camera tells, and they are taken for the image's; look at overlays"
        )
        return list(records), (), (note,)
    if float(np.median(misfits)) <= CLOSE:
        return list(records), (), ()
    kept, faults = [], []
    for record in records:
        if record.sample_id not in of_crop:
            kept.append(record)
        elif record.pose is not None:
            kept.append(replace(record, keypoints_2d=np.zeros_like(record.keypoints_2d)))
        else:
            problem = (
                "are in pixels of PRIMA's crop, whose place in the image no file tells, and there"
                " is no known camera: give K, R and t in a file of cameras/"
            )
            faults.append(SampleError(record.sample_id, "keypoints", problem))
    note = (
        f"the keypoints of {len(doubtful)} animals are in pixels of PRIMA's crops, not of the"
        " images, as their meshes tell: they are not used"
    )
    return kept, tuple(faults), (note,)


def _misfits(records: Sequence[AnimalRecord], bodies: MeshFolderBodies) -> list[float]:
    """How far the keypoints of some animals are from their meshes', by their extent."""
    known = [record for record in records if record.pose is not None]
    misfits = []
    for record in known[:: max(1, len(known) // SAMPLES)]:
        try:
            landmarks: NDArray[np.float64] = np.asarray(bodies.body(record).landmarks)
        except SampleError:
            continue  # it is reported when the animal is labelled
        if record.pose is not None:
            R, t = record.pose
            misfits.append(keypoint_misfit(landmarks @ R.T + t, record))
    return misfits
