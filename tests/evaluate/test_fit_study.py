"""Fitted bodies beside rigid and true ones: the measures, the classes, the table."""

from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import torch
from commands import ran

from animal3dbox.errors import ConfigError
from animal3dbox.evaluate.box_errors import BoxErrors, box_errors, lateral_deg
from animal3dbox.evaluate.config import EvaluateConfig
from animal3dbox.evaluate.fit_study import (
    BODIES,
    OWN,
    WORLDS,
    FitRow,
    animals_of,
    classes_of,
    fit_rows,
    fit_table,
)
from animal3dbox.evaluate.run import StudyRows, world_tables
from animal3dbox.geometry.cuboid import Cuboid
from animal3dbox.geometry.rigid_transforms import rotation_from_axis_angle


def box(turn_deg: float = 0.0, *, depth: float = 6.0, size: float = 1.0) -> Cuboid:
    """A box twice as long as wide and high, turned about its own vertical."""
    yaw = torch.tensor([0.0, 0.0, np.deg2rad(turn_deg)], dtype=torch.float64)
    R = torch.tensor([[1.0, 0, 0], [0, 0, -1.0], [0, 1.0, 0]], dtype=torch.float64)
    return Cuboid(
        torch.tensor([0.0, 0.0, depth], dtype=torch.float64),
        R @ rotation_from_axis_angle(yaw),
        size * torch.tensor([2.0, 1.0, 1.0], dtype=torch.float64),
    )


def test_distance_and_size_do_not_count() -> None:
    errors = box_errors(box(30, depth=12.0, size=3.0), box(30))
    assert (errors.deg, errors.flank) == (0.0, True)
    assert errors.iou == pytest.approx(1.0)
    assert errors.corners == pytest.approx(0.0, abs=1e-12)


def test_a_turn_is_measured_in_degrees_and_corners_by_the_diagonal() -> None:
    errors = box_errors(box(90 + 60), box(60))
    assert errors.deg == pytest.approx(90.0)
    # Corners turn about the vertical at sqrt(1 + 0.25) of it, by 90 degrees; diagonal sqrt(6)
    assert errors.corners == pytest.approx(np.sqrt(1.25) * np.sqrt(2) / np.sqrt(6))
    # Two boxes 2 x 1 crosswise share 1 x 1 of a union of 3
    assert errors.iou == pytest.approx(1 / 3)


def test_faces_nearly_edge_on_and_flanks_hardly_shown_do_not_count() -> None:
    from_side, oblique = box(0), box(40)
    assert lateral_deg(from_side) == pytest.approx(90.0)
    assert box_errors(from_side, from_side).faces is None  # front and back are edge-on
    assert box_errors(from_side, from_side).flank is True
    raised = replace(oblique, center=torch.tensor([0.5, 2.0, 6.0], dtype=torch.float64))
    assert box_errors(raised, raised).faces is True
    about = replace(
        raised, rotation=raised.rotation @ torch.diag(torch.tensor([-1.0, -1, 1])).double()
    )
    assert box_errors(about, raised).faces is False
    assert box_errors(about, raised).flank is False
    assert box_errors(box(85), box(85)).flank is None


@cache
def rows() -> tuple[FitRow, ...]:
    return tuple(row for index in (0, 1) for row in fit_rows(index))


def test_rows_are_of_every_world_and_body_and_the_true_body_is_best() -> None:
    assert {(row.world, row.body) for row in rows()} == {(w, b) for w in WORLDS for b in BODIES}
    for index in {row.index for row in rows() if row.world == "own"}:
        by_body = {
            row.body: row.errors for row in rows() if (row.index, row.world) == (index, "own")
        }
        true, fit = by_body["true body"], by_body["fit"]
        assert true is not None
        assert fit is not None
        assert true.iou > fit.iou > 0.5
        assert fit.deg < 20


def test_an_animal_is_in_one_class_of_each_kind() -> None:
    for animal in animals_of(OWN, range(8)):
        kinds = [name.partition(":")[0] for name in classes_of(animal)]
        assert kinds == ["all", "pose", "view", "keypoints"]
    (standing,) = animals_of(replace(OWN, poses=("stand",)), [1])
    assert "pose: standing" in classes_of(standing)
    above = replace(OWN, world=replace(OWN.world, uav=1.0, elevation_deg=(60.0, 80.0)))
    assert all("view: above" in classes_of(animal) for animal in animals_of(above, range(4)))


def test_the_table_counts_every_animal_once_a_class() -> None:
    good = BoxErrors(deg=2.0, iou=0.9, corners=0.02, faces=True, flank=None)
    bad = BoxErrors(deg=40.0, iou=0.5, corners=0.1, faces=None, flank=False)
    made = [
        FitRow(i, "own", "fit", ("all", "pose: standing"), errors)
        for i, errors in enumerate((good, bad, None))
    ]
    records = fit_table(made).records()
    assert [record["class"] for record in records] == ["all", "pose: standing"]
    first = records[0]
    assert (first["animals"], first["no box"], first["over 30 deg %"]) == (3, 1, 50.0)
    assert (first["trunk median deg"], first["corners median %"]) == (21.0, 6.0)
    assert (first["faces exact %"], first["flank right %"]) == (100.0, 0.0)


def test_the_table_is_there_only_if_it_was_asked_for(tmp_path: Path) -> None:
    without = StudyRows((), (), (), (), ())
    assert "fits" not in {table.name for table in world_tables(without)}
    assert "fits" in {table.name for table in world_tables(replace(without, fits=rows()))}
    with pytest.raises(ConfigError, match="fits must be 0 to 3"):
        EvaluateConfig(animals=3, fits=4)
    code, printed = ran("evaluate", tmp_path, "--fits", "3")
    assert code == 2
    assert "--fits is for our world" in printed
