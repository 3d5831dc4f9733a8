"""Pictures at URLs and in bytes, by fsspec's file system in memory."""

import io
import pickle
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import fsspec
import numpy as np
import pytest
from coco_dataset import coco_content, write_coco
from photo_dataset import HW
from PIL import ExifTags, Image

from animal3dbox.datasets import CocoKeypointsDataset
from animal3dbox.datasets.images.photos import checked_facts, header_facts, read_photo, stored_size
from animal3dbox.datasets.images.remote_files import (
    HEAD_BYTES,
    PictureUrl,
    is_remote,
    without_secrets,
)
from animal3dbox.errors import ConfigError, SampleError

STORE = "memory://animals"


@pytest.fixture
def store() -> Iterator[Any]:
    """An empty store in memory."""
    memory = fsspec.filesystem("memory")
    memory.store.clear()
    yield memory
    memory.store.clear()


def put(store: Any, name: str, content: bytes) -> str:
    """Store a content; gives its URL."""
    url = f"{STORE}/{name}"
    store.pipe(url, content)
    return url


def picture(format: str = "JPEG", **options: Any) -> bytes:
    """A picture with an orientation and a focal length in its header."""
    pixels = np.random.default_rng(0).integers(0, 256, (*HW, 3), dtype=np.uint8)
    exif = Image.Exif()
    exif[ExifTags.Base.Orientation] = 3
    exif.get_ifd(ExifTags.IFD.Exif)[ExifTags.Base.FocalLengthIn35mmFilm] = 50
    content = io.BytesIO()
    Image.fromarray(pixels).save(content, format, exif=exif, **options)
    return content.getvalue()


@pytest.mark.parametrize("format", ["JPEG", "PNG"])
def test_pixels_and_header_are_those_of_the_file(store: Any, tmp_path: Path, format: str) -> None:
    content = picture(format)
    file, url = tmp_path / "a.jpg", put(store, "a.jpg", content)
    file.write_bytes(content)
    for upright in (False, True):
        expected = read_photo(file, "a", HW, upright=upright)
        assert expected.facts.orientation == 3
        assert expected.facts.focal_px is not None
        for source in (url, content):
            photo = read_photo(source, "a", HW, upright=upright)
            assert np.array_equal(photo.pixels, expected.pixels)
            assert photo.facts == expected.facts
            assert checked_facts(source, "a", HW, upright=upright) == expected.facts
            assert header_facts(source, "a", upright=upright) == expected.facts


def test_what_is_wrong_at_a_url_names_the_sample(store: Any) -> None:
    with pytest.raises(SampleError, match=r"^me: image: memory://animals/no.jpg cannot be read"):
        read_photo(f"{STORE}/no.jpg", "me")
    broken = put(store, "broken.jpg", picture()[:500])
    with pytest.raises(SampleError, match=r"^me: image: broken.jpg cannot be decoded"):
        read_photo(broken, "me")
    with pytest.raises(SampleError, match=r"^me: image: its content cannot be decoded"):
        read_photo(b"no picture", "me")
    with pytest.raises(SampleError, match=r"me: image: nowhere://a.jpg cannot be read"):
        read_photo("nowhere://a.jpg", "me")


def test_what_is_secret_in_a_url_is_not_printed() -> None:
    assert without_secrets("s3://me:word@bucket/a.jpg?key=7") == "s3://bucket/a.jpg"
    with pytest.raises(SampleError) as caught:
        read_photo("nowhere://me:word@bucket/a.jpg?key=7", "me")
    assert "word" not in str(caught.value)
    assert "key=7" not in str(caught.value)


def test_files_of_this_machine_and_chains_are_no_urls() -> None:
    assert is_remote("https://host/a.jpg")
    for name in ("file:///etc/passwd", "local://a.jpg", "filecache::s3://b/a.jpg", "C:/a.jpg"):
        assert not is_remote(name)
    assert not is_remote("s3://a::file:///etc/passwd")


class Requests:
    """What is fetched of a store in memory, which may know no ranges, or limit their length."""

    def __init__(
        self,
        store: Any,
        monkeypatch: pytest.MonkeyPatch,
        *,
        ranges: bool = True,
        longest: int | None = None,
    ) -> None:
        self.sizes = list[int]()
        cat_file = type(store).cat_file

        def counted(
            store: Any, path: str, start: int | None = None, end: int | None = None, **more: Any
        ) -> bytes:
            content: bytes = cat_file(store, path, *((start, end) if ranges else ()), **more)
            if (start, end) != (None, None):
                content = content[:longest]
            self.sizes.append(len(content))
            return content

        monkeypatch.setattr(type(store), "cat_file", counted)


def large_picture(format: str = "JPEG", **options: Any) -> bytes:
    """A picture of more bytes than are fetched for a header."""
    content = picture(format, **options)
    assert len(content) < HEAD_BYTES
    if format == "JPEG":  # pixels that are followed by many of no meaning to a header
        return content[:-2] + bytes(2 * HEAD_BYTES) + content[-2:]
    return content + bytes(2 * HEAD_BYTES)


@pytest.mark.parametrize("ranges", [True, False])
def test_of_a_large_jpeg_a_header_is_fetched_by_ranges(
    store: Any, monkeypatch: pytest.MonkeyPatch, ranges: bool
) -> None:
    content = large_picture()
    url, requests = put(store, "a.jpg", content), Requests(store, monkeypatch, ranges=ranges)
    assert header_facts(url, "a") == header_facts(content, "a")
    assert stored_size(url, "a") == HW
    assert checked_facts(url, "a", HW) == checked_facts(content, "a", HW)
    whole = len(content)
    expected = [HEAD_BYTES, HEAD_BYTES, HEAD_BYTES, 2] if ranges else [whole, whole, whole]
    assert requests.sizes == expected


@pytest.mark.parametrize("format", ["JPEG", "PNG", "TIFF"])
@pytest.mark.parametrize("longest", [1000, HEAD_BYTES // 2])
def test_a_range_that_comes_short_is_not_taken_for_the_picture(
    store: Any, monkeypatch: pytest.MonkeyPatch, longest: int, format: str
) -> None:
    content = picture(format, icc_profile=bytes(200_000))  # in front of the size, in a JPEG
    url = put(store, "a.jpg", content)
    requests = Requests(store, monkeypatch, longest=longest)
    assert header_facts(url, "a") == header_facts(content, "a")
    assert header_facts(url, "a").orientation == 3
    assert checked_facts(url, "a", HW) == checked_facts(content, "a", HW)
    assert requests.sizes[:2] == [longest, len(content)]


@pytest.mark.parametrize("format", ["JPEG", "PNG"])
def test_a_small_picture_is_fetched_once(
    store: Any, monkeypatch: pytest.MonkeyPatch, format: str
) -> None:
    content = picture(format)
    url, requests = put(store, "a.jpg", content), Requests(store, monkeypatch)
    assert checked_facts(url, "a", HW) == checked_facts(content, "a", HW)
    assert requests.sizes == [len(content)]


def test_an_error_is_the_same_at_every_run_and_tells_no_secret(
    store: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    url = put(store, "a.jpg?token=7", b"<html>sign in</html>")
    for read in (read_photo, header_facts, stored_size):
        with pytest.raises(SampleError, match=r"^me: image: a.jpg cannot be decoded") as refused:
            read(url, "me")
        assert refused.value.problem.startswith("a.jpg cannot be decoded (it is no image")
        assert " at 0x" not in refused.value.problem

    def fails(*args: object, **more: object) -> bytes:
        raise OSError(f"{io.BytesIO()} is closed")

    monkeypatch.setattr(type(store), "cat_file", fails)
    with pytest.raises(SampleError, match=r"OSError: <_io.BytesIO object> is closed"):
        header_facts(url, "me")


def test_what_a_range_does_not_tell_is_read_whole(
    store: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    long_header = large_picture()
    long_header = long_header[:2] + 3 * (b"\xff\xfe\x80\x00" + bytes(0x7FFE)) + long_header[2:]
    png = large_picture("PNG")
    for content in (long_header, png):
        url, requests = put(store, "a.jpg", content), Requests(store, monkeypatch)
        assert checked_facts(url, "a", HW) == checked_facts(content, "a", HW)
        assert requests.sizes[-1] == len(content)
        monkeypatch.undo()


def test_a_large_jpeg_that_was_cut_off_at_a_url_is_faulty(store: Any) -> None:
    rng = np.random.default_rng(0)
    whole = io.BytesIO()
    Image.fromarray(rng.integers(0, 256, (400, 400, 3), dtype=np.uint8)).save(whole, "JPEG")
    url = put(store, "cut.jpg", whole.getvalue()[:-1000])
    assert len(whole.getvalue()) > HEAD_BYTES + 1000
    with pytest.raises(SampleError, match=r"^me: image: cut.jpg cannot be decoded"):
        checked_facts(url, "me", (400, 400))
    whole_url = put(store, "whole.jpg", whole.getvalue())
    with pytest.raises(SampleError, match=r"^me: image: its pixels are 400 x 400"):
        checked_facts(whole_url, "me", HW)
    assert checked_facts(whole_url, "me", (400, 400)).orientation == 1


def remote_dataset(store: Any, root: Path, **options: Any) -> CocoKeypointsDataset:
    """Three pictures in a store, the second of which is missing, and the annotations here."""
    content = coco_content(root)
    for number, image in enumerate(content["images"]):
        file = root / "images" / image["file_name"]
        if number != 1:
            put(store, image["file_name"], file.read_bytes())
        image["file_name"] = f"{STORE}/{image['file_name']}"
        file.unlink()
    path = write_coco(root, content)
    return CocoKeypointsDataset(path, body="dog", on_bad="skip", **options)


def test_a_dataset_reads_pictures_at_urls(store: Any, tmp_path: Path) -> None:
    dataset = remote_dataset(store, tmp_path, index=tmp_path / "indexes")
    assert dataset.image_id(0) == f"{STORE}/a.jpg"
    source = dataset.source
    assert source.photo(source.sample(0)).pixels.shape == (*HW, 3)
    assert source.sample(0).records[0].image_path == PictureUrl(f"{STORE}/a.jpg")
    assert "memory://animals/sub/b.jpg cannot be read" in dataset[1].cases[0].problem  # type: ignore[union-attr]
    assert [*(tmp_path / "indexes").glob("*.index")]
    received: CocoKeypointsDataset = pickle.loads(pickle.dumps(dataset))
    assert received.source.sample(0).image_path == f"{STORE}/a.jpg"


def test_records_that_are_all_there_have_urls_too(store: Any, tmp_path: Path) -> None:
    dataset = remote_dataset(store, tmp_path, check_paths=True)
    source = dataset.source
    assert source.photo(source.sample(0)).pixels.shape == (*HW, 3)
    assert source.sample(0).records[0].image_path == PictureUrl(f"{STORE}/a.jpg")


def test_urls_of_pictures_that_were_downloaded_are_their_files(tmp_path: Path) -> None:
    content = coco_content(tmp_path)
    for image in content["images"]:
        image["file_name"] = f"https://animals.org/photos/{image['file_name']}"
    dataset = CocoKeypointsDataset(write_coco(tmp_path, content), body="dog")
    assert [dataset.image_id(index) for index in range(len(dataset))] == ["a.jpg", "sub/b.jpg"]


def test_without_the_extra_the_error_names_it(
    tmp_path: Path, store: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "fsspec", None)
    with pytest.raises(ConfigError, match=r"pip install 'animal3dbox\[remote\]'"):
        read_photo("s3://bucket/a.jpg", "me")
    with pytest.raises(ConfigError, match=r"pip install 'animal3dbox\[remote\]'"):
        remote_dataset(store, tmp_path)
