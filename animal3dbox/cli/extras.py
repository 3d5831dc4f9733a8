"""The package's optional extras, and which distributions it needs, as its metadata tell.

Nothing here imports what it asks about: a broken torch must not break the answer.
"""

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from importlib import metadata

PACKAGE = "animal3dbox"
WITHOUT: Mapping[str, str] = {
    "plots": "`animal3dbox evaluate` draws no figures.",
    "deeplabcut": "DeepLabCut's `.h5` tables cannot be read (its `.csv` can).",
    "remote": "pictures at URLs (`s3://`, `https://`) cannot be read.",
    "parquet": "tables of whole datasets are CSV.",
    "ray": "`label --table` runs on this machine alone, not on a cluster of Ray.",
    "metrics": "there is no `TorchBoxMetrics` for training loops (`BoxMetrics` needs nothing).",
    "lightning": "`examples/lightning_module.py` does not run.",
    "rerun": "there are no recordings for Rerun.",
    "build-body": "the embedded quadruped, which is shipped, cannot be built anew.",
    "docs": "the site of the documentation cannot be built.",
    "dev": "the package's tests, types and style cannot be checked.",
}
"""What each extra's absence costs, in one sentence; docs/install.md has the same."""
_REQUIREMENT = re.compile(
    r"(?P<name>[\w.-]+) *(\[(?P<extras>[^]]*)\])? *\(?(?P<range>[^;)]*)\)?"
    r"(;.*extra *== *[\"'](?P<of>[\w-]+)[\"'])?"
)


@dataclass(frozen=True)
class Requirement:
    """A distribution that the package, or one of its extras, needs.

    Attributes:
        name: of the distribution.
        versions: that are admitted, ">=2.0,<3"; empty: any.
        extras: of that distribution.
        extra: of our package that needs it; None: it needs it always.
    """

    name: str
    versions: str
    extras: tuple[str, ...] = ()
    extra: str | None = None

    @property
    def installed(self) -> str | None:
        """The installed version, None if there is none."""
        return installed_version(self.name)

    @property
    def fits(self) -> bool:
        """Whether a version is installed that is admitted."""
        return self.installed is not None and is_admitted(self.installed, self.versions)

    def __str__(self) -> str:
        """The requirement as `pip install` takes it: name, extras and admitted versions."""
        extras = f"[{','.join(self.extras)}]" if self.extras else ""
        return f"{self.name}{extras}{self.versions}"


def installed_version(distribution: str) -> str | None:
    """The version of a distribution that is installed here, None if there is none."""
    try:
        return metadata.version(distribution)
    except metadata.PackageNotFoundError:
        return None


def parsed_requirement(text: str) -> Requirement:
    """A line of a distribution's metadata.

    Example:
        >>> parsed_requirement('h5py<4,>=3.11; extra == "deeplabcut"')
        Requirement(name='h5py', versions='<4,>=3.11', extras=(), extra='deeplabcut')
    """
    parts = _REQUIREMENT.match(text)
    if parts is None:
        raise ValueError(f"not a requirement: {text!r}")
    extras = tuple(one.strip() for one in (parts["extras"] or "").split(",") if one.strip())
    return Requirement(parts["name"], parts["range"].replace(" ", ""), extras, parts["of"])


def requirements() -> tuple[Requirement, ...]:
    """What the installed package needs, its extras' needs too; nothing if it is not installed."""
    try:
        lines = metadata.requires(PACKAGE) or []
    except metadata.PackageNotFoundError:
        return ()
    return tuple(parsed_requirement(line) for line in lines)


def of_extra(name: str, all_requirements: tuple[Requirement, ...]) -> Iterator[Requirement]:
    """The distributions that an extra brings, those of extras that it is made of too.

    Args:
        name: of the extra.
        all_requirements: requirements().

    """
    for one in all_requirements:
        if one.extra != name:
            continue
        if one.name == PACKAGE:
            for part in one.extras:
                yield from of_extra(part, all_requirements)
        else:
            yield one


def is_admitted(version: str, versions: str) -> bool:
    """Whether a version lies in a range of bounds, by its numbers; what it cannot read, it admits.

    Example:
        >>> is_admitted("2.13.0+cpu", ">=2.6,<3"), is_admitted("3.0", ">=2.6,<3")
        (True, False)
    """
    return all(
        _meets(version, *bound.groups())
        for bound in (re.fullmatch(r"(>=|<=|==|<|>)([\d.]+)", one) for one in versions.split(","))
        if bound is not None
    )


def _meets(version: str, relation: str, bound: str) -> bool:
    mine, its = _numbers(version), _numbers(bound)
    width = max(len(mine), len(its))
    mine, its = (numbers + (0,) * (width - len(numbers)) for numbers in (mine, its))
    return {
        ">=": mine >= its,
        "<=": mine <= its,
        "==": mine == its,
        "<": mine < its,
        ">": mine > its,
    }[relation]


def _numbers(version: str) -> tuple[int, ...]:
    """The numbers that a version begins with."""
    release = re.match(r"\d+(\.\d+)*", version)
    return () if release is None else tuple(int(part) for part in release[0].split("."))
