"""What happens in one `dataset[0]`: calls, files, depth, and the shapes an animal passes through.

Run by house_counts.py, in a process of its own, with the checkout on PYTHONPATH:
python benchmarks/house_trace.py CHECKOUT PHOTOGRAPHS; prints JSON.
PHOTOGRAPHS is a StanfordExtra folder with keypoints and masks, as `animal3dbox synth` writes it.

How it is traced: a StanfordExtraDataset with default options, without a cache. `dataset[1]` and
`dataset[0]` are read first, so that what is loaded or computed once does not count; then
`dataset[0]` is read under sys.setprofile, once for the calls and once for the shapes, and
`dataset[1]` once for its calls.
"""

import dataclasses
import gc
import importlib
import json
import os
import sys
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from enum import Enum
from pathlib import Path
from types import FrameType
from typing import Any

os.environ.setdefault("OMP_NUM_THREADS", "1")

import torch

import animal3dbox
from animal3dbox.datasets import StanfordExtraDataset

PACKAGE = str(Path(animal3dbox.__file__).parent) + os.sep
DOORS = ("geometry", "labels", "smal", "report", "evaluate", "datasets", "transforms", "training")
NOT_SHAPES = {
    "Cuboid": "a geometric value: a box by centre, rotation and size",
    "FaceVisibility": "a geometric value: how much of a box's faces is in view",
    "ProjectedTriangles": "the rasteriser's triangles in pixels",
    "Sides": "the rasteriser's edges, row by row",
    "Local": "a solver's value at one point: cost, gradient, Gauss-Newton matrix",
    "LocalModel": "a solver's value at one point: cost, gradient, Gauss-Newton matrix",
    "Photo": "the picture itself, which holds no animal",
    "PhotoFacts": "the picture's header, which holds no animal",
    "_OneThread": "sets the number of threads, and holds nothing else",
    "_Reader": "checks arguments; of the animal it holds the sample's name only",
    "ArgumentChecks": "the same by its new name",
    "Sample": "the pair (image, target) that a Dataset gives: a tuple, after the last shape",
}
"""Classes that do not count as shapes of an animal, and why; whatever else is made does count."""
MOST_FIELDS = 12


@dataclass
class CallTrace:
    """Counts the package's Python frames, as a profile function for sys.setprofile.

    A frame counts if its code's file lies in the package; generated code (a dataclass's
    `__init__`) and libraries do not. Lambdas, comprehensions, generator expressions and class
    bodies, whose names begin with "<", count only among "all" frames: whether comprehensions
    have frames depends on Python's version, and a generator has one more for each value.
    """

    all_calls: int = 0
    named_calls: int = 0
    depth: int = 0
    greatest_depth: int = 0
    files: set[str] = field(default_factory=set)

    def __call__(self, frame: FrameType, event: str, value: object) -> None:
        """Note one event."""
        if event not in ("call", "return") or not frame.f_code.co_filename.startswith(PACKAGE):
            return
        if event == "return":
            self.depth -= 1
            return
        self.depth += 1
        self.all_calls += 1
        self.named_calls += not frame.f_code.co_name.startswith("<")
        self.greatest_depth = max(self.greatest_depth, self.depth)
        self.files.add(frame.f_code.co_filename)


class ShapeTrace:
    """Collects every instance of the package's classes that is made, with the code that made it.

    An instance is noticed when its `__init__` returns (plain classes, dataclasses, attrs), when
    a NamedTuple's `__new__`, `_make` or `_replace` returns, which are Python frames of generated
    code, or when a function of the package returns it, alone or in a tuple or list, though it
    was not there before (msgspec.Struct, `object.__new__`; of what the garbage
    collector does not track, "before" is not known). Exceptions and enums do not count.
    """

    def __init__(self) -> None:
        self.before = [thing for thing in gc.get_objects() if _is_of_package(thing)]
        self.instances = dict.fromkeys(map(id, self.before))
        self.creations: list[tuple[object, str, list[str]]] = []

    def __call__(self, frame: FrameType, event: str, value: object) -> None:
        """Note one event."""
        if event == "return":
            for instance in self._candidates(frame, value):
                if _is_of_package(instance) and id(instance) not in self.instances:
                    self.instances[id(instance)] = None
                    self.creations.append((instance, _maker(frame), _empty_fields(instance)))

    def _candidates(self, frame: FrameType, value: object) -> Iterator[object]:
        code = frame.f_code
        if code.co_name == "__init__" and code.co_argcount:
            yield frame.f_locals.get(code.co_varnames[0])
            return
        in_package = code.co_filename.startswith(PACKAGE)
        of_tuple = str(frame.f_globals.get("__name__")).startswith("namedtuple_")
        if in_package or of_tuple or code.co_name in ("_make", "_replace", "__new__"):
            yield value
        if in_package and isinstance(value, tuple | list):
            yield from value

    def shapes(self) -> list[dict[str, Any]]:
        """Each class with its fields, its instances, and the code that made them."""
        classes = {
            f"{type(i).__module__}.{type(i).__name__}": type(i) for i, _, _ in self.creations
        }
        return [self._shape(classes[name]) for name in sorted(classes)]

    def _shape(self, kind: type) -> dict[str, Any]:
        instances = [(i, empty) for i, _, empty in self.creations if type(i) is kind]
        names = list(dict.fromkeys(name for i, _ in instances for name in field_names(i)))
        stages = [stage for i, empty in instances for stage in (empty, _empty_fields(i))]
        changing = [n for n in names if 0 < sum(n in empty for empty in stages) < len(stages)]
        return {
            "name": kind.__name__,
            "module": kind.__module__.removeprefix("animal3dbox."),
            "fields": len(names),
            "None in one stage and set in another": changing,
            "instances": len(instances),
            "made in": dict(Counter(place for i, place, _ in self.creations if type(i) is kind)),
            "not a shape": NOT_SHAPES.get(kind.__name__),
            "counts": 2 if len(names) > MOST_FIELDS or changing else 1,
        }


def field_names(instance: object) -> list[str]:
    """The fields that a class declares; of a plain class, the attributes an instance has."""
    kind: Any = type(instance)
    if dataclasses.is_dataclass(kind):
        return [one.name for one in dataclasses.fields(kind)]
    if hasattr(kind, "__attrs_attrs__"):
        return [one.name for one in kind.__attrs_attrs__]
    names = getattr(kind, "_fields", None) or getattr(kind, "__struct_fields__", None)
    return list(names) if names else list(getattr(instance, "__dict__", ()))


def _empty_fields(instance: object) -> list[str]:
    return [name for name in field_names(instance) if getattr(instance, name, None) is None]


def _is_of_package(thing: object) -> bool:
    kind = type(thing)
    return str(kind.__module__).startswith("animal3dbox") and not issubclass(
        kind, BaseException | Enum | type
    )


def _maker(frame: FrameType) -> str:
    """The function of the package that made an instance: the nearest that is no constructor."""
    at: FrameType | None = frame
    while at is not None:
        code = at.f_code
        if code.co_filename.startswith(PACKAGE) and code.co_name not in ("__init__", "__new__"):
            name = code.co_qualname.replace(".<locals>", "")
            return f"{code.co_filename.removeprefix(PACKAGE)}:{name}"
        at = at.f_back
    return "?"


def trace(dataset: StanfordExtraDataset, index: int, profile: Any) -> None:
    """Read one sample under a profile function."""
    sys.setprofile(profile)
    try:
        dataset[index]
    finally:
        sys.setprofile(None)


def call_counts(dataset: StanfordExtraDataset, index: int) -> dict[str, int]:
    """The calls, files and depth of one sample."""
    calls = CallTrace()
    trace(dataset, index, calls)
    sample: Any = dataset[index]
    return {
        f"dataset[{index}]: animals": len(sample[1]["boxes"]),
        f"dataset[{index}]: calls of named functions": calls.named_calls,
        f"dataset[{index}]: calls, lambdas and comprehensions too": calls.all_calls,
        f"dataset[{index}]: files": len(calls.files),
        f"dataset[{index}]: greatest depth": calls.greatest_depth,
    }


def main(arguments: Sequence[str]) -> None:
    """Print what is counted of the checkout's package as JSON."""
    checkout, photographs = Path(arguments[0]), Path(arguments[1])
    if not PACKAGE.startswith(str(checkout.resolve())):
        raise SystemExit(f"animal3dbox is {PACKAGE}, not of {checkout}: put that on PYTHONPATH")
    torch.set_num_threads(1)
    dataset = StanfordExtraDataset(photographs)
    for index in (1, 0):
        dataset[index]
    shape_trace = ShapeTrace()
    trace(dataset, 0, shape_trace)
    shapes = shape_trace.shapes()
    animal_shapes = [shape for shape in shapes if shape["not a shape"] is None]
    doors = {name: importlib.import_module(f"animal3dbox.{name}") for name in DOORS}
    counts = {
        **call_counts(dataset, 0),
        **call_counts(dataset, 1),
        "shapes: classes": len(animal_shapes),
        "shapes: large or changing ones twice": sum(shape["counts"] for shape in animal_shapes),
        **{f"names of animal3dbox.{n}": len(getattr(d, "__all__", ())) for n, d in doors.items()},
    }
    print(json.dumps({"counts": counts, "shapes": shapes}))


if __name__ == "__main__":
    main(sys.argv[1:])
