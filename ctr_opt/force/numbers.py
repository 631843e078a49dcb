"""Numbers of unknown loads: their names and parts, and their estimates with errors."""

from __future__ import annotations

import operator
from collections.abc import Sequence
from functools import cached_property
from typing import Any

import attrs
import numpy as np

from ..checks import Array
from ..loads.kind import Load
from ..robot.names import loads_with, parsed
from .unknown import UnknownLoad


def one_or_all(values: Sequence[Any]) -> Any:
    """The value of a single unknown load, or the values of several."""
    return values if len(values) > 1 else values[0]


@attrs.frozen(eq=False, slots=False)
class Numbered:
    """Unknown loads, the loads that represent them, and the names, labels and parts of their numbers.

    ``names`` are the model's parameter names; its first ``first`` loads are known.
    """

    unknown: tuple[UnknownLoad, ...]
    first: int
    templates: tuple[Load, ...]
    names: tuple[str, ...]
    labels: tuple[str, ...]
    parts: tuple[slice, ...]

    @classmethod
    def of(cls, unknown: tuple[UnknownLoad, ...], first: int) -> Numbered:
        """The numbers of unknown loads that follow ``first`` known loads."""
        templates: list[Load] = []
        names: list[str] = []
        labels: list[str] = []
        parts = []
        for k, unknown_load in enumerate(unknown):
            numbers = unknown_load.unknown_numbers
            prefix = f"unknown[{k}]." if len(unknown) > 1 else ""
            names += [f"loads[{first + len(templates) + load}].{field}" for load, field in unknown_load.taken]
            parts.append(slice(len(labels), len(labels) + sum(number.size for number in numbers)))
            labels += [prefix + label for number in numbers for label in number.labels]
            templates += unknown_load.loads()
        return cls(unknown, first, tuple(templates), tuple(names), tuple(labels), tuple(parts))

    def serves(self, unknown: tuple[UnknownLoad, ...]) -> bool:
        """Whether the same loads represent the given unknown loads."""
        if len(unknown) == len(self.unknown) and all(map(operator.is_, unknown, self.unknown)):
            return True
        return self.templates == tuple(load for one in unknown for load in one.loads())

    @cached_property
    def fields(self) -> list[str]:
        """The field of each number."""
        return [number.field for one in self.unknown for number in one.unknown_numbers for _ in range(number.size)]

    def where(self, field: str) -> list[slice]:
        """Slices of the numbers of a field, one for each unknown load that has it."""
        starts = [
            (part.start + self.fields[part].index(field), part) for part in self.parts if field in self.fields[part]
        ]
        return [slice(start, start + self.fields[part].count(field)) for start, part in starts]

    @property
    def resultants(self) -> list[Array]:
        """Matrices ``(3, numbers)`` from all unknown numbers to the total force of each load."""
        resultants = []
        for part, one in zip(self.parts, self.unknown, strict=True):
            rows = np.zeros((3, len(self.labels)))
            rows[:, part] = one.resultant
            resultants.append(rows)
        return resultants

    def roughness(self) -> Array | None:
        """Quadratic form of all numbers for a distributed force of unknown smoothness; None without one."""
        form = np.zeros((len(self.labels),) * 2)
        for part, one in zip(self.parts, self.unknown, strict=True):
            if one.roughly:
                form[part, part] = one.roughness
        return form if form.any() else None

    def loads_at(self, known: Sequence[Load], numbers: Array) -> list[Load]:
        """The known loads and the unknown ones at the given numbers of the model."""
        values: dict[str, Any] = {}
        start = 0
        for name in self.names:
            _, k, field = parsed(name)
            size = 1 if field == "arc_length" else 3
            number = numbers[start] if size == 1 else numbers[start : start + size]
            values[f"loads[{int(k) - self.first}].{field}"] = number
            start += size
        return [*known, *loads_with(self.templates, values)]


class Estimated:
    """Base of results: estimates of all unknown numbers, SI, in the order of ``labels``, and their covariance."""

    labels: tuple[str, ...]
    numbered: Numbered
    estimates: Array

    @property
    def covariance(self) -> Array:
        """Covariance of the numbers of :attr:`labels`, SI."""
        raise NotImplementedError

    @property
    def values(self) -> dict[str, float]:
        """Estimates of all numbers by label, SI."""
        return dict(zip(self.labels, self.estimates.tolist(), strict=True))

    @property
    def deviations(self) -> Array:
        """Standard deviations of the numbers of :attr:`labels`, SI."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def force(self) -> Array:
        """Estimated force ``(3,)``, N, world frame; ``(k, 3)`` for several unknown loads.

        For a distributed force this is the total.
        """
        return np.asarray(one_or_all([rows @ self.estimates for rows in self.numbered.resultants]))

    @property
    def force_covariance(self) -> Array:
        """Covariance of :attr:`force` ``(3, 3)``, N^2; ``(k, 3, 3)`` for several unknown loads."""
        return np.asarray(one_or_all([rows @ self.covariance @ rows.T for rows in self.numbered.resultants]))

    @property
    def moment(self) -> Array | None:
        """Estimated moment at the tip ``(3,)``, N m, world frame; None without an unknown moment."""
        return next((self.estimates[part] for part in self.numbered.where("moment")), None)

    def _in_words(self) -> str:
        both = zip(self.values.items(), self.deviations, strict=True)
        return ", ".join(f"{label} = {x:.4g} +- {s:.2g}" for (label, x), s in both)
