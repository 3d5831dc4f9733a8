"""The bodies of a dataset that has parameters for some of its animals: their own, else a fit."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

from animal3dbox.datasets.bodies.fitted import FittedBodies
from animal3dbox.datasets.bodies.sources import BodySource, ParametersBody
from animal3dbox.datasets.records import AnimalRecord
from animal3dbox.datasets.storage.fingerprint import digest
from animal3dbox.labels.body import Body


@dataclass(frozen=True)
class OwnOrFittedBodies:
    """A body source that poses an animal's own parameters, or has the same model fitted to it.

    A label request asks `of` which source an animal has, so that each is labelled with others of
    its kind; both are of one model, and so in one unit.

    Attributes:
        own: the parameters of the animals that have some.
        fitted: the same model, to be fitted.
        to_fit: sample ids of the animals that it is fitted to.
    """

    own: ParametersBody
    fitted: FittedBodies
    to_fit: frozenset[str]

    @property
    def name(self) -> str:
        """The sources' names, as reports print them."""
        return f"{self.own.name}, {len(self.to_fit)} others fitted"

    @property
    def fingerprint(self) -> bytes:
        """Digest of both sources; which animal has which follows from its content."""
        return digest(self.own.fingerprint, self.fitted.fingerprint)

    @property
    def lasting(self) -> bool:
        """Whether the parameters are packed."""
        return self.own.lasting

    def of(self, sample_id: str) -> BodySource:
        """The source of one animal's body."""
        return self.fitted if sample_id in self.to_fit else self.own

    def content(self, sample_id: str) -> bytes:
        """What the body of this animal alone depends on; raises SampleError if it has none."""
        return self.of(sample_id).content(sample_id)

    def body(self, record: AnimalRecord) -> Body:
        """The animal's own body, or the rigid one that stands in where none can be fitted."""
        return self.of(record.sample_id).body(record)

    def packed(self) -> "OwnOrFittedBodies":
        """The same source with its parameters in a few tensors, for workers."""
        return replace(self, own=self.own.packed())


def own_or_fitted(own: ParametersBody, records: Sequence[AnimalRecord]) -> BodySource:
    """The source of bodies of animals some of which may have no parameters.

    Those whose camera is not known either stay without a body: their focal length, estimated with
    a fit, would contradict that of the animals beside them.

    Args:
        own: the dataset's parameters.
        records: all of its animals.

    """
    to_fit = frozenset(
        record.sample_id
        for record in records
        if record.sample_id not in own.parameters and record.K is not None
    )
    return OwnOrFittedBodies(own, FittedBodies(own.model), to_fit) if to_fit else own
