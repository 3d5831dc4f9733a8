"""Every kind of mistake, in every format of JSON that can have it, is told by sample and field."""

from pathlib import Path

import pytest
from fault_table import ALL, KEYS, KINDS, image_of
from photo_dataset import View, toy_scene, view_of
from written_otherwise import JsonSet, json_set

from animal3dbox.datasets import AnnotatedDataset
from animal3dbox.datasets.labelling.load_report import Case

CELLS = [(name, format) for name, kind in KINDS.items() for format in kind.formats]


@pytest.fixture(scope="module")
def view() -> View:
    return view_of(toy_scene(), 70)


def cases_of(made: JsonSet) -> tuple[Case, ...]:
    """What a Dataset that leaves out what is wrong says when all of it has been loaded."""
    dataset = AnnotatedDataset(
        made.write(), images=made.root / "images", body="preset", on_bad="skip"
    )
    for index in range(len(dataset)):
        dataset[index]
    return tuple(case for case in dataset.report().cases if case.kind == "fault")


@pytest.mark.parametrize("format", ALL)
def test_a_set_without_a_mistake_has_none(format: str, tmp_path: Path, view: View) -> None:
    assert cases_of(json_set(format, tmp_path / "set", view)) == ()


@pytest.mark.parametrize(("name", "format"), CELLS)
def test_a_mistake_is_told_by_sample_and_field(
    name: str, format: str, tmp_path: Path, view: View
) -> None:
    kind, made = KINDS[name], json_set(format, tmp_path / "set", view)
    others = {image[key] for image, key in made.images} - {name_of(made)}
    kind.plant(made)
    cases = cases_of(made)
    told = [case for case in cases if any(key in case.field for key in kind.fields(format))]
    assert told, [str(case) for case in cases]
    wanted = (name_of(made),) if kind.names_image else ELEMENTS[format]
    assert any(name in told[0].sample_id for name in wanted), told[0]
    assert not any(case.sample_id in others for case in cases), "it spoils no other"


def name_of(made: JsonSet) -> str:
    """The first animal's image, as the file names it."""
    return str(image_of(made).get(KEYS["image"][made.format]))


ELEMENTS = {
    "coco": ("image 1", "annotation 3"),
    "stanfordextra": ("entry ",),
    "animal3d": ("entry ",),
}
