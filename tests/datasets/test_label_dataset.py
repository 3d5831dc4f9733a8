"""The Dataset: what comes out, what is left out, and what is said about it."""

import gc
import pickle
from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from one_label import label_of
from PIL import ExifTags, Image
from small_animals import HW, model_of, small_dataset, spoiled
from torch.utils.data import default_collate

from animal3dbox.datasets import Animal3DDataset, AnnotatedDataset, SyntheticDataset
from animal3dbox.datasets.bodies.sources import preset_body
from animal3dbox.datasets.formats import read_dataset
from animal3dbox.datasets.label_dataset import LabelDataset
from animal3dbox.datasets.labelling.file_source import FileSource
from animal3dbox.datasets.labelling.filters import LabelFilter
from animal3dbox.datasets.labelling.scale import (
    AltitudeScale,
    KnownScale,
    SpeciesScale,
    head_and_body,
)
from animal3dbox.datasets.labelling.skipped import Skipped, Target
from animal3dbox.datasets.read_options import ReadOptions
from animal3dbox.datasets.records import AnimalRecord, RecordSet
from animal3dbox.datasets.storage.fingerprint import code_files
from animal3dbox.datasets.synthetic.synthetic_set import SyntheticSet
from animal3dbox.datasets.synthetic.world.config import WorldConfig
from animal3dbox.errors import ConfigError, SampleError
from animal3dbox.labels.config import LabelConfig
from animal3dbox.labels.label_row import WIDTH
from animal3dbox.labels.types import CuboidLabel, Quality
from animal3dbox.transforms import Compose, RandomHorizontalFlip, RandomResizedCrop

SHAPES = {
    "corners_3d": (8, 3), "center": (3,), "rotation": (3, 3), "size": (3,), "corners_2d": (8, 2),
    "corner_in_front": (8,), "face_visible": (6,),
    "face_area": (6,), "face_share": (6,), "face_share_in_image": (6,), "R": (3, 3), "t": (3,),
    "boxes": (4,), "labels": (), "truncation": (),
    "behind_camera": (), "keypoints": (26, 3), "masks": HW, "scale_known": (),
    "scale_m_per_unit": (),
}  # fmt: skip
DTYPES = {
    "labels": torch.int64, "masks": torch.uint8,
    **dict.fromkeys(("corner_in_front", "face_visible", "behind_camera", "scale_known"),
        torch.bool),
}  # fmt: skip


def used(dataset: LabelDataset, index: int = 0) -> tuple[torch.Tensor, Target]:
    sample = dataset[index]
    assert not isinstance(sample, Skipped)
    return sample


def crowded(dataset: LabelDataset) -> int:
    """An image with several animals, of train.json."""
    return next(
        i
        for i in range(len(dataset))
        if len(dataset.source.sample(i).records) > 1 and "/train/" in f"/{dataset.image_id(i)}"
    )


# What comes out
# --------------------------------------------------------------------------------------------------


def test_a_sample_is_an_image_and_a_target_of_the_documented_shapes(animals: Path) -> None:
    dataset = small_dataset(animals)
    for index in range(len(dataset)):
        image, target = used(dataset, index)
        count = len(dataset.source.sample(index).records)
        assert (image.shape, image.dtype) == ((3, *HW), torch.uint8)
        for name, shape in SHAPES.items():
            assert tuple(target[name].shape) == (count, *shape), name
            assert target[name].dtype == DTYPES.get(name, torch.float32), name
        assert target["K"].shape == (3, 3)
        assert target["image_id"] == dataset.image_id(index)
        assert len(target["meta"]["quality"]) == len(target["meta"]["scale_source"]) == count
        assert [dataset.classes[n] for n in target["labels"]] == [
            record.category for record in dataset.source.sample(index).records
        ]
        assert not any(
            torch.isnan(v).any()
            for v in target.values()
            if isinstance(v, torch.Tensor) and v.is_floating_point()
        )


def test_the_image_is_the_file(animals: Path) -> None:
    dataset = small_dataset(animals)
    image, target = used(dataset)
    stored = np.asarray(Image.open(animals / target["image_id"]).convert("RGB"))
    assert np.array_equal(image.permute(1, 2, 0).numpy(), stored)


def test_labels_are_those_that_the_records_get(animals: Path) -> None:
    dataset = small_dataset(animals, stored_cameras="hypothesis", config=LabelConfig())
    read = read_dataset(animals, options=ReadOptions(model=model_of(animals)))
    assert read.bodies is not None
    made = {
        record.sample_id: label_of(record, read.bodies, LabelConfig())
        for record in read.records.records[:4]
    }
    seen = 0
    for index in range(len(dataset)):
        for number, record in enumerate(dataset.source.sample(index).records):
            label = made.get(record.sample_id)
            if isinstance(label, CuboidLabel):
                _, target = used(dataset, index)
                for name in (
                    "corners_3d",
                    "center",
                    "rotation",
                    "size",
                    "corners_2d",
                    "face_share",
                    "R",
                    "t",
                    "surface_share",
                    "keypoints",
                ):
                    assert torch.equal(target[name][number], getattr(label, name).float()), name
                assert torch.equal(target["boxes"][number], label.box.float())
                assert target["meta"]["quality"][number]["mask_iou"] == label.quality.mask_iou
                seen += 1
    assert seen == 4


def test_a_stored_camera_is_a_guess_unless_told_otherwise(animals: Path) -> None:
    guessed, exact = (
        used(small_dataset(animals, stored_cameras="hypothesis"))[1],
        used(small_dataset(animals, stored_cameras="exact"))[1],
    )
    assert {q["pose_source"] for q in guessed["meta"]["quality"]} == {"estimated"}
    assert {q["pose_source"] for q in exact["meta"]["quality"]} == {"given"}
    assert torch.equal(exact["R"][0], torch.eye(3))


def test_one_body_can_serve_all_animals(animals: Path) -> None:
    dataset = Animal3DDataset(animals, body="cat", on_bad="skip")
    assert (
        dataset.source.fingerprint
        == preset_body("cat").fingerprint
        != preset_body("dog").fingerprint
    )


def test_a_transform_gets_the_sample_and_its_key(animals: Path) -> None:
    augment = Compose([RandomHorizontalFlip(0.5), RandomResizedCrop(64)], seed=1)
    dataset = small_dataset(animals, transform=augment)
    image, target = used(dataset, 1)
    again = used(dataset, 1)
    assert image.shape == (3, 64, 64)
    assert torch.equal(image, again[0])
    assert torch.equal(target["H_out_in"], again[1]["H_out_in"])
    dataset.set_epoch(1)
    assert not torch.equal(target["H_out_in"], used(dataset, 1)[1]["H_out_in"])
    assert torch.equal(target["H_out_in"], dataset[0, 1][1]["H_out_in"])  # type: ignore[index]


def test_a_transform_that_fails_names_the_image(animals: Path) -> None:
    def broken(image: torch.Tensor, target: Target) -> tuple[torch.Tensor, Target]:
        raise ZeroDivisionError("of the user's own")

    with pytest.raises(ZeroDivisionError) as caught:
        small_dataset(animals, transform=broken)[0]
    assert any("in the transform of image images/" in note for note in caught.value.__notes__)


def test_the_synthetic_world_needs_no_files() -> None:
    world = replace(WorldConfig(), image_hw=HW)
    dataset = SyntheticDataset(SyntheticSet(0, 3, world))
    image, target = used(dataset, 2)
    assert image.shape == (3, *HW)
    assert target["image_id"] == "0-000002"
    truth = [
        animal.cuboid.center
        for animal in SyntheticSet(0, 3, world).samples().__next__().scene.animals
    ]
    assert torch.allclose(
        used(dataset, 0)[1]["center"], torch.stack(truth).float(), atol=0.05
    )  # the label's box, of torso vertices


def test_a_dataset_survives_pickling(animals: Path) -> None:
    dataset = small_dataset(animals)
    again = pickle.loads(pickle.dumps(dataset))
    assert torch.equal(used(dataset, 3)[1]["corners_3d"], used(again, 3)[1]["corners_3d"])


def test_the_number_of_a_class_can_be_fixed(animals: Path) -> None:
    own = small_dataset(animals)
    classes = ("unicorn", *reversed(own.classes))
    dataset = small_dataset(animals, classes=classes)
    assert [classes[n] for n in used(dataset)[1]["labels"]] == [
        own.classes[n] for n in used(own)[1]["labels"]
    ]


# What is left out
# --------------------------------------------------------------------------------------------------


def corrupt_image(folder: Path, dataset: LabelDataset, index: int) -> str:
    image = dataset.image_id(index)
    (folder / image).write_bytes((folder / image).read_bytes()[:200])
    return image


def test_an_unreadable_image_is_an_error_that_names_it(copied: Path) -> None:
    dataset = small_dataset(copied)
    image = corrupt_image(copied, dataset, 2)
    with pytest.raises(SampleError) as caught:
        dataset[2]
    assert (caught.value.sample_id, caught.value.field) == (image, "image")


def test_skipping_says_what_was_skipped_and_why(copied: Path) -> None:
    dataset = small_dataset(copied, on_bad="skip")
    image = corrupt_image(copied, dataset, 2)
    sample = dataset[2]
    assert isinstance(sample, Skipped)
    assert (sample.index, sample.image_id, len(sample.cases)) == (2, image, 1)
    dataset[2], dataset[3]
    report = dataset.report()
    assert [(case.kind, case.sample_id, case.field) for case in report.cases] == [
        ("fault", image, "image")
    ]
    assert len(dataset.case_file.path.read_text().splitlines()) == 1
    assert image in str(report)
    assert report.counts == {"fault": 1}


def test_a_dataset_leaves_no_file_behind(
    copied: Path, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    (place := tmp_path / "temporary").mkdir()
    monkeypatch.setattr("tempfile.tempdir", str(place))
    dataset = small_dataset(copied, on_bad="skip")
    dataset[1]
    assert not list(place.iterdir())  # a process that is killed could not remove it
    corrupt_image(copied, dataset, 2)
    dataset[2]
    assert list(place.iterdir()) == [dataset.case_file.path]
    assert dataset.case_file.path.stat().st_mode & 0o077 == 0  # it names samples and files
    del dataset
    gc.collect()
    assert not list(place.iterdir())


def test_a_bad_animal_takes_nothing_from_its_neighbours(copied: Path) -> None:
    crowd = small_dataset(copied)
    place = crowded(crowd)
    before, (first, *_) = used(crowd, place)[1], crowd.source.sample(place).records
    assert first.mask_path is not None  # type: ignore[union-attr]
    first.mask_path.write_bytes(b"no png")  # type: ignore[union-attr]
    kept = used(small_dataset(copied, on_bad="skip"), place)[1]
    assert torch.equal(kept["corners_3d"], before["corners_3d"][1:])
    assert torch.equal(kept["masks"], before["masks"][1:])
    whole = small_dataset(copied, on_bad="skip", partial="skip")
    assert isinstance(whole[place], Skipped)
    assert whole.report().cases[0].sample_id == first.sample_id


def test_partial_images_are_left_out_with_a_word_on_their_good_animals(copied: Path) -> None:
    place = crowded(small_dataset(copied))
    first, second, *_ = (
        record.sample_id for record in small_dataset(copied).source.sample(place).records
    )

    def change(entries: list[dict[str, Any]]) -> None:
        entry = next(entry for entry in entries if entry["img_path"] == first)
        entry["keypoint_2d"] = [[0, 0, 0]] * 26

    spoiled(copied, change)
    dataset = small_dataset(copied, on_bad="skip", partial="skip", stored_cameras="hypothesis")
    assert isinstance(dataset[place], Skipped)
    assert [(case.kind, case.sample_id) for case in dataset.report().cases] == [
        ("rejected", first),
        ("filtered", second),
    ]


@pytest.mark.parametrize("name", ["a#b.jpg", "a#1.jpg", "a#1"])
def test_an_image_with_a_mark_in_its_name_is_known_to_have_unread_animals(
    copied: Path, name: str
) -> None:
    place = crowded(small_dataset(copied))
    old = small_dataset(copied).image_id(place)
    (copied / old).rename(copied / name)

    def change(entries: list[dict[str, Any]]) -> None:
        mine = [entry for entry in entries if entry["img_path"] == old]
        mine[-1]["keypoint_2d"] = "x"
        for entry in mine:
            entry["img_path"] = name

    spoiled(copied, change)
    dataset = small_dataset(copied, on_bad="skip", partial="skip")
    place = next(i for i in range(len(dataset)) if dataset.image_id(i) == name)
    assert isinstance(dataset[place], Skipped)


def test_annotations_that_cannot_be_read_stop_or_are_reported(copied: Path) -> None:
    def cut(entries: list[dict[str, Any]]) -> None:
        entries[1]["keypoint_2d"] = entries[1]["keypoint_2d"][:5]

    whole = small_dataset(copied)
    spoiled(copied, cut)
    with pytest.raises(SampleError, match=r"keypoint_2d: .*on_bad='skip'"):
        small_dataset(copied)
    dataset = small_dataset(copied, on_bad="skip")
    (fault,) = dataset.report().of("fault")
    assert fault.field == "keypoint_2d"
    assert (
        sum(len(dataset.source.sample(i).records) for i in range(len(dataset)))
        == sum(len(whole.source.sample(i).records) for i in range(len(whole))) - 1
    )


def test_a_rejection_is_an_error_or_is_reported_with_its_reason(copied: Path) -> None:
    def hide(entries: list[dict[str, Any]]) -> None:
        for row in entries[0]["keypoint_2d"][4:]:
            row[2] = 0

    spoiled(copied, hide)
    options: dict[str, Any] = {"stored_cameras": "hypothesis"}
    strict = small_dataset(copied, **options)
    with pytest.raises(SampleError, match="label: cannot be made, too_few_keypoints: "):
        strict[0]
    dataset = small_dataset(copied, **options, on_bad="skip")
    dataset[0]
    assert [(case.kind, case.field) for case in dataset.report().cases] == [
        ("rejected", "too_few_keypoints")
    ]


@pytest.mark.parametrize(
    "limits",
    [{"min_mask_iou": 1.0}, {"min_inlier_share": 1.0}, {"max_reprojection_error_px": 0.0},
        {"min_confidence": 1.0}, {"min_box_px": 1e4},
     {"max_truncation": 0.0}],
)  # fmt: skip
def test_a_filter_leaves_out_what_misses_it_and_says_so(
    animals: Path, limits: dict[str, float]
) -> None:
    dataset = small_dataset(animals, filters=LabelFilter(**limits), stored_cameras="hypothesis")  # type: ignore[arg-type]
    whole = small_dataset(animals, stored_cameras="hypothesis")
    kept = [sample for i in range(4) if not isinstance(sample := dataset[i], Skipped)]
    cases = dataset.report().of("filtered")
    assert {case.field for case in cases} <= set(limits)
    assert sum(len(target["labels"]) for _, target in kept) + len(cases) == sum(
        len(whole.source.sample(i).records) for i in range(4)
    )
    assert cases or limits.keys() & {"max_truncation", "min_inlier_share"}


def test_keypoints_outside_the_frame_are_not_visible(copied: Path) -> None:
    def moved(entries: list[dict[str, Any]]) -> None:
        for entry in entries:
            entry["keypoint_2d"][3] = [-4.0, 10.0, 1.0]

    spoiled(copied, moved)
    dataset = small_dataset(copied, on_bad="skip")
    points = torch.cat(
        [
            sample[1]["keypoints"]
            for i in range(len(dataset))
            if not isinstance(sample := dataset[i], Skipped)
        ]
    )
    moved_out = points[:, 3, 0] == -4
    assert bool(moved_out.any())
    assert not bool(points[moved_out, 3, 2].any())
    assert bool((points[moved_out][..., 2] > 0).any())


def test_the_limits_of_inliers_and_truncation() -> None:
    quality = Quality(
        reprojection_error_px=2.0,
        n_keypoints=10,
        n_inliers=7,
        mask_iou=None,
        orientation_rule="",
        pose_source="given",
        pose_hypothesis="given",
        bounds_source="vertices",
        mask_source="none",
        K_source="given",
        warnings=(),
    )
    blank = CuboidLabel("a", (9, 9), np.zeros(WIDTH), None, quality)
    label = blank.with_fields(truncation=0.3, box=(0, 0, 9, 9))
    assert LabelFilter(min_inlier_share=0.7, max_truncation=0.3).problem(label) is None
    assert LabelFilter(min_inlier_share=0.71).problem(label) == (
        "min_inlier_share",
        "is 0.7, the limit 0.71",
    )
    assert LabelFilter(max_truncation=0.29).problem(label) == (
        "max_truncation",
        "is 0.3, the limit 0.29",
    )
    near = label.with_fields(behind_camera=True)
    assert LabelFilter().problem(near) is None
    problem = LabelFilter(allow_behind_camera=False).problem(near)
    assert problem is not None
    assert problem[0] == "allow_behind_camera"
    unseen = label.with_fields(box=(9, 0, 9, 9))
    assert (LabelFilter().problem(unseen) or ("",))[0] == "allow_unseen"
    assert LabelFilter(allow_unseen=True).problem(unseen) is None


def test_a_measure_that_is_missing_fails_its_limit(animals: Path) -> None:
    dataset = small_dataset(
        animals,
        filters=LabelFilter(min_mask_iou=0.1),
        config=LabelConfig(surface_share=False, mask_iou=False),
    )
    assert isinstance(dataset[0], Skipped)
    assert "is not known" in dataset.report().cases[0].problem


def test_another_category_than_the_classes_is_a_fault(animals: Path) -> None:
    with pytest.raises(SampleError, match=r"category: .* is none of the classes unicorn"):
        small_dataset(animals, classes=("unicorn",))[0]


def test_the_report_can_be_kept(copied: Path, tmp_path: Path) -> None:
    dataset = small_dataset(copied, on_bad="skip", report_to=tmp_path / "deep" / "report.jsonl")
    corrupt_image(copied, dataset, 0)
    dataset[0]
    again = small_dataset(copied, on_bad="skip", report_to=tmp_path / "deep" / "report.jsonl")
    assert again.report() == dataset.report()
    assert again.report().cases


@pytest.mark.parametrize(
    ("options", "says"),
    [({"on_bad": "ignore"}, "on_bad must be"), ({"partial": "drop"}, "partial must be"),
        ({"stored_cameras": "trust"}, "stored_cameras must be"),
     ({"classes": ("a", "a")}, "classes must differ")],
)  # fmt: skip
def test_wrong_options_say_what_they_can_be(
    animals: Path, options: dict[str, Any], says: str
) -> None:
    with pytest.raises(ConfigError, match=says):
        small_dataset(animals, **options)


def test_records_without_bodies_ask_for_them() -> None:
    with pytest.raises(ConfigError, match="needs a source of their bodies"):
        FileSource(RecordSet("x", (), ()))


@pytest.mark.parametrize("index", [8, -9])
def test_an_index_out_of_range_ends_iteration(animals: Path, index: int) -> None:
    with pytest.raises(IndexError):
        small_dataset(animals)[index]


# Cameras and metres
# --------------------------------------------------------------------------------------------------


def test_a_photo_s_own_focal_length_beats_the_dataset_s(copied: Path) -> None:
    image = copied / small_dataset(copied).image_id(0)
    exif = Image.Exif()
    exif[ExifTags.IFD.Exif] = {int(ExifTags.Base.FocalLengthIn35mmFilm): 100}
    Image.open(image).save(image, exif=exif, quality=95)
    target = used(small_dataset(copied, stored_cameras="hypothesis"))[1]
    assert target["meta"]["K_source"] == "exif"
    assert float(target["K"][0, 0]) == pytest.approx(
        100 / np.hypot(36, 24) * np.hypot(*HW), rel=1e-6
    )
    exact = used(small_dataset(copied))[1]  # a pose that is known holds for the camera it came with
    assert (exact["meta"]["K_source"], float(exact["K"][0, 0])) == ("dataset", 1000.0)


def test_labels_are_metric_only_if_something_tells_the_scale(animals: Path) -> None:
    plain, metric = (
        used(small_dataset(animals))[1],
        used(small_dataset(animals, scale=KnownScale(2.0)))[1],
    )
    assert not plain["scale_known"].any()
    assert set(plain["meta"]["scale_source"]) == {"unknown"}
    for name in ("corners_3d", "center", "size", "t"):
        assert torch.allclose(metric[name], 2 * plain[name])
    for name in ("corners_2d", "face_area", "rotation", "R"):
        assert torch.equal(metric[name], plain[name])
    assert metric["scale_known"].all()
    assert metric["scale_m_per_unit"].tolist() == [2.0] * len(metric["labels"])
    assert set(metric["meta"]["scale_source"]) == {"user"}


def test_the_species_table_makes_an_animal_as_long_as_its_kind(animals: Path) -> None:
    dataset = small_dataset(animals, scale=SpeciesScale({"bear": 1.8, "dog": 0.85}))
    for index in range(len(dataset)):
        sample, target = dataset.source.sample(index), used(dataset, index)[1]
        for number, record in enumerate(sample.records):
            known = record.category in ("bear", "dog")
            assert bool(target["scale_known"][number]) == known
            assert target["meta"]["scale_source"][number] == (
                f"species:{record.category}" if known else "unknown"
            )
            if known:
                body = sample.bodies.body(record)  # type: ignore[union-attr,arg-type]
                length = head_and_body(record.vocabulary, body.landmarks)  # type: ignore[union-attr]
                assert length is not None
                assert float(target["scale_m_per_unit"][number]) * length == pytest.approx(
                    {"bear": 1.8, "dog": 0.85}[record.category], rel=1e-5
                )


def test_a_known_altitude_puts_the_lowest_corner_that_far_below(animals: Path) -> None:
    target = used(small_dataset(animals, scale=AltitudeScale(30.0, down_cam=(0.0, 0.0, 2.0))))[1]
    assert torch.allclose(target["corners_3d"][..., 2].amax(1), torch.tensor(30.0))
    assert set(target["meta"]["scale_source"]) == {"altitude"}
    with pytest.raises(SampleError, match="altitude_m: the animal stands above the camera"):
        small_dataset(animals, scale=AltitudeScale(30.0, down_cam=(0.0, 0.0, -1.0)))[0]
    one = small_dataset(animals).image_id(0)
    some = small_dataset(animals, scale=AltitudeScale({one: 5.0}))
    assert used(some, 0)[1]["scale_known"].all()
    assert not used(some, 1)[1]["scale_known"].any()


@pytest.mark.parametrize(
    "make",
    [
        lambda: KnownScale(0.0),
        lambda: AltitudeScale(-1.0),
        lambda: AltitudeScale(1.0, (0, 0, 0)),
        lambda: SpeciesScale({"dog": -1.0}),
    ],
)
def test_a_scale_that_is_none_is_refused(make: Any) -> None:
    with pytest.raises(ConfigError):
        make()


@pytest.mark.parametrize("scale", [SpeciesScale(), KnownScale(2.0), AltitudeScale(3.0)])
def test_a_scale_reaches_spawned_workers(scale: Any) -> None:
    assert pickle.loads(pickle.dumps(scale)) == scale


@pytest.mark.parametrize("metres", [0.0, -1.0, float("nan"), float("inf")])
def test_a_scale_of_the_user_s_own_that_gives_nonsense_is_a_fault(
    animals: Path, metres: float
) -> None:
    class Own:
        def metres_per_unit(self, record: Any, body: Any, label: Any) -> tuple[float, str]:
            return metres, "own"

    with pytest.raises(SampleError, match="scale: metres per unit must be positive, Own gave"):
        small_dataset(animals, scale=Own())[0]


def test_the_format_is_recognised(animals: Path) -> None:
    assert len(AnnotatedDataset(animals, model=model_of(animals))) == 8


def test_the_label_code_s_digest_sees_every_file_that_labels_depend_on() -> None:
    seen = {f"{path.parent.name}/{path.name}" for path in code_files()}
    assert {
        "labels/label.py",
        "images/photos.py",
        "images/masks.py",
        "images/rle.py",
        "images/exif.py",
        "bodies/mesh_formats.py",
        "bodies/sources.py",
    } <= seen
    assert {
        "geometry/rasterizer.py",
        "smal/model.py",
        "labelling/scale.py",
        "storage/codec.py",
        "mesh_folder/reader.py",
    } <= seen
    assert any(path.suffix == ".npz" for path in code_files())


def test_known_cameras_are_not_pretended(animals: Path) -> None:
    with pytest.raises(
        ConfigError, match="stored_cameras 'exact' needs cameras that come with the dataset"
    ):
        Animal3DDataset(
            animals, body="dog", stored_cameras="exact"
        )  # without a model nothing tells whether the stored ones are right


@pytest.mark.parametrize("index", [[0, 1], slice(0, 2), None, (1, 2, 3), "0", 1.5])
def test_an_index_that_is_none_says_what_it_must_be(animals: Path, index: Any) -> None:
    with pytest.raises(TypeError, match="an index must be a whole number or a pair"):
        small_dataset(animals)[index]


def test_whole_numbers_of_any_type_are_indices(animals: Path) -> None:
    dataset = small_dataset(animals)
    for index in (np.int64(2), torch.tensor(2), -6, (np.int32(0), torch.tensor(2))):
        assert used(dataset, index)[1]["meta"]["sample_key"] == (0, 2)  # type: ignore[arg-type]


def test_skipped_samples_in_another_collate_say_which_to_take(copied: Path) -> None:
    dataset = small_dataset(copied, on_bad="skip")
    corrupt_image(copied, dataset, 0)
    with pytest.raises(TypeError, match=r"give the DataLoader collate_fn=dataset\.collate_fn"):
        default_collate([dataset[1], dataset[0]])
    with pytest.raises(TypeError, match=r"was skipped .*collate_fn=dataset\.collate_fn"):
        default_collate([dataset[0], dataset[1]])


def test_a_scale_that_is_a_number_is_refused_at_once(animals: Path, tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="scale must be a KnownScale"):
        small_dataset(animals, scale=2.0)
    with pytest.raises(ConfigError, match="scale has no name in a cache"):
        small_dataset(animals, scale=KnownScale(Fraction(1, 2)), cache=tmp_path)  # type: ignore[arg-type]


def test_animals_keep_their_names_when_their_neighbours_are_left_out(copied: Path) -> None:
    whole = small_dataset(copied)
    place = crowded(whole)
    first, *others = whole.source.sample(place).records
    assert isinstance(first, AnimalRecord)
    assert first.mask_path is not None
    first.mask_path.write_bytes(b"no png")
    assert used(small_dataset(copied, on_bad="skip"), place)[1]["meta"]["sample_ids"] == [
        record.sample_id for record in others
    ]
