"""Forty animals: what the evaluation finds, the size that fits into every run of the tests."""

from dataclasses import replace
from typing import Any

import pytest

from animal3dbox.datasets.synthetic.world.config import WorldConfig
from animal3dbox.evaluate.config import EvaluateConfig
from animal3dbox.evaluate.run import evaluate_world, world_tables

CONFIG = EvaluateConfig(animals=40, every=40, world=replace(WorldConfig(), image_hw=(240, 320)))


@pytest.fixture(scope="module")
def tables() -> dict[str, list[dict[str, Any]]]:
    return {table.name: table.records() for table in world_tables(evaluate_world(CONFIG))}


def row(records: list[dict[str, Any]], **wanted: str) -> dict[str, Any]:
    return next(
        record for record in records if all(record[key] == value for key, value in wanted.items())
    )


def test_every_class_of_view_agrees_with_the_rays(tables: dict[str, list[dict[str, Any]]]) -> None:
    for record in tables["faces"]:
        assert record["views"] >= 38
        assert record["booleans right %"] == 100
        assert record["in-frame share max error"] <= 0.01
        assert record["share max error"] is None or record["share max error"] <= 0.01


def test_our_axes_are_nearer_to_the_trunk_than_the_papers_and_pca(
    tables: dict[str, list[dict[str, Any]]],
) -> None:
    median_deg = {record["rule"]: record["median deg"] for record in tables["accuracy"]}
    assert median_deg["ours, mesh"] < 4
    assert median_deg["ours, landmarks"] < 4
    assert median_deg["ours, re-meshed"] < 8
    assert median_deg["ours, mesh"] < median_deg["landmarks (paper)"] < median_deg["pca of mesh"]


def test_the_default_pose_beats_the_papers_against_clean_keypoints(
    tables: dict[str, list[dict[str, Any]]],
) -> None:
    for setting in ("2 px", "2 px, 10 % outliers"):
        ours, squared = (
            row(tables["pose"], setting=setting, method=method)
            for method in ("default", "paper (vector)")
        )
        assert ours["animals"] == 40
        assert ours["labelled"] >= 30
        assert ours["clean median px"] < 2.5
        assert ours["clean mean px"] < squared["clean mean px"]
        assert ours["degenerate %"] == ours["depth flip %"] == 0


def test_the_papers_figures_are_marked_as_such(tables: dict[str, list[dict[str, Any]]]) -> None:
    assert row(tables["pose"], method="basic, PAPER")["annotated mean px"] == 75.28
    assert row(tables["stability"], protocol="(PAPER)", rule="pca")["theta_R deg"] == 120.68
    assert (
        row(tables["reproduction"], keypoints="(PAPER, Animal3D)", method="theirs")["mean px"]
        == 7.56
    )
