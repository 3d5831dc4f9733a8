"""Why an animal was flagged or rejected, in whole sentences, and what to do about it."""

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from animal3dbox.labels.types import FLAGS as LABEL_FLAGS
from animal3dbox.labels.types import REASONS
from animal3dbox.report.summary import FLAGS

FLAG_SENTENCES = {
    "low_confidence": "The box is right with a probability of {confidence:.0%}.",
    "exchanged": (
        "Left and right keypoints are exchanged in the file; the label was made of them put right."
    ),
    "few_inliers": "{n_inliers} of {n_keypoints} visible keypoints fit the pose.",
    "low_overlap": "The projected body overlaps the mask by {mask_iou:.2f} of 1.",
    "truncated": "{truncation:.0%} of the box lies outside the image.",
    "near_camera": "A corner of the box is at or behind the camera.",
    "unseen": "The image shows nothing of the animal.",
    "not_turned": "The file's EXIF header asks to turn the picture, and it was not turned.",
    "misplaced": "The keypoints lie beside the frame, or beside the animal's own box or mask.",
    "off_mask": "The body under its known camera lies beside the mask.",
}
"""What is the matter with one animal, by its numbers; a sentence for each of FLAGS."""

FLAG_REMEDIES = {
    "low_confidence": (
        "Look whether the crossed, green front is at the head and the box stands on the animal. If"
        " so, keep it; if not, correct its keypoints, or leave the animal out."
    ),
    "exchanged": (
        "Look whether the box's left is the animal's own left. If so, correct the file; if not,"
        " label it with --labelings keep."
    ),
    "few_inliers": (
        "Look for keypoints off their joints and correct them: one that is wrong is better marked"
        " as not visible."
    ),
    "low_overlap": (
        "Look whether the mask is this animal's and the body is of its species (--species); if both"
        " are, correct the keypoints."
    ),
    "truncated": (
        "Trust the sides that are seen. The box's size and distance are guesses beyond the image's"
        " border: leave the animal out where these matter."
    ),
    "near_camera": (
        "Look whether the camera's focal length is right (--focal-px). If the animal does stand so"
        " near, use the box with care: some of its corners have no pixel."
    ),
    "unseen": "Look whether the annotation belongs to this image, and leave the animal out.",
    "not_turned": (
        "If the keypoints were made on the turned picture, label with --orientation apply."
    ),
    "misplaced": (
        "Look whether the annotation belongs to this image and its size, and to this animal; with"
        " --misplaced fault such animals are refused."
    ),
    "off_mask": (
        "Look which of the two is wrong: the stored camera (with --stored-camera hypothesis it is"
        " only tried) or the mask."
    ),
}
"""What to do about each of FLAGS."""

REASON_REMEDIES = {
    "too_few_keypoints": "Mark more of the joints that are seen, on the head and the trunk first.",
    "coplanar_keypoints": (
        "Mark a joint out of that plane, such as a leg of the other side or an ear."
    ),
    "no_axes": "Name the landmarks of the body (--landmarks), or mark nose, spine and legs.",
    "no_pose": (
        "Look whether the keypoints are this animal's and in the order of their names"
        " (--vocabulary), and whether the focal length is right (--focal-px)."
    ),
    "behind_camera": (
        "Look whether the stored camera is of this image and in this package's frame, whose z"
        " points into the picture."
    ),
    "beyond_lens": "Look whether the lens's distortion is that of this camera.",
    "degenerate_box": "Look whether the body's unit and the camera's are the same.",
    "no_body": "Give a body for this species (--body, --species), or name one in the dataset.",
}
"""What to do about each of the reasons for which an animal has no label."""


class Finding(NamedTuple):
    """A cause for looking at an animal.

    Attributes:
        key: of FLAGS, or of REASONS.
        sentence: what is the matter with this animal.
    """

    key: str
    sentence: str


class Explanation(NamedTuple):
    """What a flag or a reason means for any animal.

    Attributes:
        key: of FLAGS, or of REASONS.
        meaning: in one sentence.
        remedy: what to do.
    """

    key: str
    meaning: str
    remedy: str


def flag_findings(
    flags: Sequence[str], numbers: Mapping[str, Any], causes: Sequence[str] = ()
) -> tuple[Finding, ...]:
    """Why a label was flagged.

    Args:
        flags: that it raises, of FLAGS; or the label's own ones, where it has no probability.
        numbers: of the label, by name: confidence, truncation, n_inliers, n_keypoints, mask_iou.
        causes: the label's own flags (labels.types.FLAGS), which tell why its probability is low.

    Example:
        >>> flag_findings(("truncated",), {"truncation": 0.42})[0].sentence
        '42% of the box lies outside the image.'
        >>> (low,) = flag_findings(("low_confidence",), {"confidence": 0.3}, ("ambiguous",))
        >>> low.sentence.split(". ")[1]
        'Another orientation explains the animal nearly as well.'
    """
    sentences = {**_CAUSE_SENTENCES, **FLAG_SENTENCES}
    clauses = [
        LABEL_FLAGS[cause] for cause in causes if cause in LABEL_FLAGS and cause not in FLAGS
    ]
    reasons = {"low_confidence": " ".join(_sentence(clause) for clause in clauses)}
    return tuple(
        Finding(
            flag,
            f"{sentences.get(flag, '').format_map(numbers) or f'It raises {flag}.'}"
            f" {reasons.get(flag, '')}".rstrip(),
        )
        for flag in flags
    )


def rejection_finding(reason: str, detail: str) -> Finding:
    """Why an animal has no label.

    Example:
        >>> rejection_finding("too_few_keypoints", "3 visible, 6 needed").sentence
        'Fewer visible keypoints than min_keypoints: 3 visible, 6 needed.'
    """
    meaning = _sentence(REASONS.get(reason, reason))
    return Finding(reason, f"{meaning[:-1]}: {detail.removesuffix('.')}." if detail else meaning)


def explanations() -> list[Explanation]:
    """Every flag and every cause of doubt, then every reason for which an animal is rejected."""
    doubt = FLAG_REMEDIES["low_confidence"]
    return [
        *(Explanation(key, _sentence(FLAGS[key]), FLAG_REMEDIES[key]) for key in FLAGS),
        *(Explanation(key, sentence, doubt) for key, sentence in _CAUSE_SENTENCES.items()),
        *(Explanation(key, _sentence(REASONS[key]), REASON_REMEDIES[key]) for key in REASONS),
    ]


def flag_meaning(flag: str) -> str:
    """What a flag means, in a clause; nothing if it is not known.

    Example:
        >>> flag_meaning("ambiguous")
        'another orientation explains the animal nearly as well'
    """
    return FLAGS.get(flag) or LABEL_FLAGS.get(flag, "")


def _sentence(clause: str) -> str:
    return f"{clause[:1].upper()}{clause[1:]}."


_CAUSE_SENTENCES = {
    cause: _sentence(clause) for cause, clause in LABEL_FLAGS.items() if cause not in FLAGS
}
"""What a label's own flags say that are no flags of a run but causes of a low probability."""
