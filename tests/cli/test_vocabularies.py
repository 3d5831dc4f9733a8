"""The command `vocabularies` names every vocabulary, place and mirror image."""

from pathlib import Path

import pytest

from animal3dbox.cli.main import main
from animal3dbox.smal.keypoints.known_places import KNOWN_PLACES
from animal3dbox.smal.keypoints.vocabularies import VOCABULARIES
from animal3dbox.smal.keypoints.vocabulary import load_vocabulary


def printed(capsys: pytest.CaptureFixture[str], *arguments: str) -> str:
    """What the command prints."""
    with pytest.raises(SystemExit) as caught:
        main(["vocabularies", *arguments])
    assert caught.value.code == 0
    return capsys.readouterr().out


def test_all_vocabularies_and_all_places_are_listed(capsys: pytest.CaptureFixture[str]) -> None:
    words = printed(capsys).split()
    assert {f"{name}:" for name in VOCABULARIES} | set(KNOWN_PLACES) <= set(words)


@pytest.mark.parametrize("name", VOCABULARIES)
def test_every_keypoint_stands_with_its_place_and_its_mirror_image(
    name: str, capsys: pytest.CaptureFixture[str]
) -> None:
    vocabulary = VOCABULARIES[name]
    rows = printed(capsys, name).splitlines()[1:]
    assert len(rows) == len(vocabulary)
    for row, keypoint, places, twin in zip(
        rows, vocabulary.keypoints, vocabulary.landmarks, vocabulary.flip, strict=True
    ):
        assert row.startswith(f"{keypoint} ")
        assert row.endswith(f"  {vocabulary.keypoints[twin]}")
        assert all(place in row for place in places or ("not on the body",))


def test_a_file_of_ones_own_is_listed_with_its_notes(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "own.toml"
    file.write_text(
        'name = "own"\n[keypoints]\nL = "left_shoulder"\nR = "right_shoulder"\n[flip]\nL = "R"\n'
    )
    lines = printed(capsys, str(file)).splitlines()
    assert lines[1].split() == ["L", "left_shoulder", "R"]
    assert "say left_shoulder_point" in lines[-1]


def test_what_is_no_vocabulary_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as caught:
        main(["vocabularies", "dog"])
    assert caught.value.code == 2
    assert "vocabulary must be one of animal3d26" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("keypoints", "flip", "words"),
    [
        ('nose = ["noze", "nosse"]', "", "'noze', which no body has"),
        ('nose = "joint:pelvs"', "", "nearest: joint:pelvis"),
        ('nose = "vertex:99999"', "", "at vertices [99999]"),
        ('nose = "nose"\ntail = "tail_base"', 'nose = "tail"', "say in [flip]"),
    ],
)
def test_places_that_no_body_has_and_wrong_twins_are_refused(
    tmp_path: Path, keypoints: str, flip: str, words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "own.toml"
    file.write_text(f'name = "own"\n[keypoints]\n{keypoints}\n[flip]\n{flip}\n')
    with pytest.raises(SystemExit) as caught:
        main(["vocabularies", str(file)])
    assert caught.value.code == 2
    assert words in capsys.readouterr().err


def test_a_second_place_that_no_body_here_has_is_told(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "own.toml"
    file.write_text('name = "own"\n[keypoints]\nnose = ["nose", "noze"]\n')
    assert "names the place 'noze' of 'nose'" in printed(capsys, str(file))


def test_the_file_that_is_shown_is_one(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    lines = printed(capsys).splitlines()
    begin = lines.index('  name = "my_dogs"')
    file = tmp_path / "own.toml"
    file.write_text("\n".join(line.strip() for line in lines[begin : lines.index("", begin)]))
    assert load_vocabulary(file).keypoints == ("Nose", "LF_paw", "RF_paw", "collar")
