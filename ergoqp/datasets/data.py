"""The data that learned costs are fitted to: points, their labels, and the names of the columns."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ergoqp.arguments import names_of, table_of_numbers
from ergoqp.coordinates import Coordinates
from ergoqp.errors import ModelError


@dataclass(frozen=True, eq=False)
class DataSet:
    """Labelled points.

    Attributes:
        points: inputs of the model (n, d) [rad or m].
        labels: score of each (n,) [points].
        coordinates: names of the columns, see `ergoqp.coordinates.Coordinates`.
        source: a short description of the data.

    Raises:
        ModelError: if shapes do not fit together, or a value is not finite.

    Example:
        >>> import numpy as np
        >>> from ergoqp.datasets.data import DataSet
        >>> data = DataSet(np.zeros((10, 1)), np.arange(10.0), ("trunk_flexion",), "by hand")
        >>> train, test = data.split(0.8)
        >>> train.points.shape, test.labels.shape
        ((8, 1), (2,))
    """

    points: NDArray[np.float64]
    labels: NDArray[np.float64]
    coordinates: tuple[str, ...]
    source: str = "given"

    def __post_init__(self) -> None:
        """Check that the shapes fit together and that all values are finite.

        Raises:
            ModelError: if not; the message names the row or the shape.
        """
        points, labels = (
            table_of_numbers("points", self.points, ModelError),
            table_of_numbers("labels", self.labels, ModelError),
        )
        names = names_of("coordinates", self.coordinates, "a list of names", ModelError)
        object.__setattr__(self, "coordinates", names)
        width = len(Coordinates(names))
        if points.ndim != 2 or points.shape[1] != width:
            raise ModelError(
                f"data: got points of shape {points.shape}, allowed (n, {width}):"
                f" {', '.join(self.coordinates)}"
            )
        if labels.shape != (len(points),):
            raise ModelError(
                f"data: got labels of shape {labels.shape}, allowed ({len(points)},), one per point"
            )
        bad = np.flatnonzero(~(np.isfinite(points).all(axis=1) & np.isfinite(labels)))
        if bad.size:
            raise ModelError(
                f"data: row {bad[0]} is not finite ({bad.size} such rows), allowed numbers only"
            )
        object.__setattr__(self, "points", points)
        object.__setattr__(self, "labels", labels)

    def __len__(self) -> int:
        """Return the number of points."""
        return len(self.labels)

    def part(self, rows: NDArray) -> DataSet:
        """Return the data set of some rows, given as numbers (k,) or as a mask (n,)."""
        return DataSet(self.points[rows], self.labels[rows], self.coordinates, self.source)

    def split(self, share: float = 0.8, seed: int = 0) -> tuple[DataSet, DataSet]:
        """Return two disjoint data sets, drawn at random; the first has this share of the rows."""
        order = np.random.default_rng(seed).permutation(len(self))
        cut = round(share * len(self))
        return self.part(order[:cut]), self.part(order[cut:])

    def require(self, least: int, what: str) -> None:
        """Check that there are enough data to fit a model.

        Args:
            least: least number of points.
            what: what is fitted, for the message.

        Raises:
            ModelError: if there are too few points, or all labels are the same.
        """
        if len(self) < least:
            raise ModelError(f"{what}: got {len(self)} points, allowed at least {least}")
        if np.ptp(self.labels) == 0:
            raise ModelError(
                f"{what}: got the label {self.labels[0]:g} everywhere, allowed at least two"
                " different labels"
            )
