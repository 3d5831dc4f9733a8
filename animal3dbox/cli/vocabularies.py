"""The command `vocabularies`: which keypoints are known, and where on a body each of them is."""

from collections.abc import Iterator

from animal3dbox.cli.exit_codes import ExitCode
from animal3dbox.cli.setup_jobs import VocabulariesJob
from animal3dbox.smal.keypoints.known_places import KNOWN_PLACES
from animal3dbox.smal.keypoints.vocabularies import VOCABULARIES, vocabulary_of_option
from animal3dbox.smal.keypoints.vocabulary import Vocabulary
from animal3dbox.smal.quadruped.preset_bodies import load_quadruped

NO_PLACE = "(not on the body)"
EXAMPLE = """\
name = "my_dogs"
[keypoints]
Nose = "nose"
LF_paw = "left_front_paw"
RF_paw = "right_front_paw"
collar = []  # nowhere on the body: not used
"""
"""The beginning of a vocabulary of one's own."""


def run_vocabularies(job: VocabulariesJob) -> ExitCode:
    """Print all known vocabularies and the body's places, or one vocabulary keypoint by keypoint.

    Raises:
        ConfigError: no such vocabulary, or a file that is none.

    """
    lines = _overview() if job.name is None else _keypoints(_checked(job.name))
    print("\n".join(lines))
    return ExitCode.OK


def _checked(option: str) -> Vocabulary:
    """A vocabulary whose places the embedded quadruped has, or knows; raises ConfigError."""
    vocabulary, model = vocabulary_of_option(option), load_quadruped()
    model.read_keypoints(vocabulary, model.v_template)
    return vocabulary


def _overview() -> Iterator[str]:
    """A line a vocabulary, and the places that a vocabulary of one's own may name."""
    for name, vocabulary in VOCABULARIES.items():
        on_body = sum(bool(places) for places in vocabulary.landmarks)
        yield f"{name}: {len(vocabulary)} keypoints, {on_body} of them on the body"
    yield ""
    yield "Places on the body, for the TOML file of a vocabulary of your own:"
    yield from (f"  {place}" for place in KNOWN_PLACES)
    yield ""
    yield "Such a file, for --vocabulary: each of your keypoints in its order, and where it is:"
    yield from (f"  {line}" for line in EXAMPLE.splitlines())
    yield ""
    yield "With a name or a file: every keypoint, its place and its mirror image."


def _keypoints(vocabulary: Vocabulary) -> Iterator[str]:
    """A line a keypoint: its name, its places, best first, and its mirror image."""
    rows = [("keypoint", "place on the body", "mirror image")]
    for keypoint, places, twin in zip(
        vocabulary.keypoints, vocabulary.landmarks, vocabulary.flip, strict=True
    ):
        rows.append((keypoint, ", else ".join(places) or NO_PLACE, vocabulary.keypoints[twin]))
    widths = [max(len(row[column]) for row in rows) for column in range(2)]
    for row in rows:
        yield f"{row[0]:{widths[0]}}  {row[1]:{widths[1]}}  {row[2]}"
    yield from vocabulary.notes
