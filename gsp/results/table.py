"""`Table`: named arrays over named dimensions, and what other libraries make of them."""

from __future__ import annotations

import importlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from gsp.errors import OutputError
from gsp.results.plain import plain


@dataclass(frozen=True, eq=False)
class Column:
    """An array and the names of its `dimensions`."""

    dimensions: tuple[str, ...]
    values: np.ndarray


@dataclass(frozen=True, eq=False)
class Table:
    """Coordinates and variables by name; `rows` are the dimensions of its data frame, `records` its rows if not these.

    A coordinate called like a dimension labels it.
    """

    what: str
    coordinates: Mapping[str, Column]
    variables: Mapping[str, Column]
    attributes: Mapping[str, str | float | int | None]
    rows: tuple[str, ...] = ()
    records: Sequence[Mapping[str, object]] | None = None

    @property
    def sizes(self) -> dict[str, int]:
        """Lengths of the dimensions."""
        columns = (*self.coordinates.values(), *self.variables.values())
        return {name: n for c in columns for name, n in zip(c.dimensions, c.values.shape)}

    def as_json(self) -> dict[str, Any]:
        """Plain values; nan and infinity are None."""
        return {
            "what": self.what,
            "dimensions": self.sizes,
            "coordinates": _written(self.coordinates),
            "variables": _written(self.variables),
            "attributes": plain(self.attributes),
        }

    def to_xarray(self) -> Any:
        """An `xarray.Dataset`."""
        xarray = library("xarray", "a Dataset is made by")
        return xarray.Dataset(
            {name: (c.dimensions, c.values) for name, c in self.variables.items()},
            {name: (c.dimensions, c.values) for name, c in self.coordinates.items()},
            {"what": self.what, **{n: v for n, v in self.attributes.items() if v is not None}},
        )

    def to_pandas(self) -> Any:
        """A `pandas.DataFrame`."""
        pandas = library("pandas", "a data frame is made by")
        if self.records is not None:
            frame = pandas.DataFrame([dict(record) for record in self.records])
        else:
            frame = pandas.DataFrame(self.columns())
            index = [name for name in self.rows if name in frame]
            frame = frame.set_index(index) if index else frame
        scalars = {n: c.values.item() for n, c in self.coordinates.items() if not c.dimensions}
        frame.attrs.update({"what": self.what, **self.attributes, **scalars})
        return frame

    def as_rows(self) -> list[Mapping[str, object]]:
        """The rows of the data frame, for a CSV file."""
        if self.records is not None:
            return list(self.records)
        columns = {name: values.tolist() for name, values in self.columns().items()}
        return [dict(zip(columns, row)) for row in zip(*columns.values())]

    def columns(self) -> dict[str, np.ndarray]:
        """What lies along `rows`, or is the same along some of them, as arrays of one length."""
        sizes = self.sizes
        shape = tuple(sizes[name] for name in self.rows)
        given = {name: self.coordinates.get(name, _counted(name, sizes[name])) for name in self.rows}
        given |= {name: c for name, c in self.coordinates.items() if c.dimensions}
        given |= self.variables
        found = {}
        for name, column in given.items():
            if column.dimensions and set(column.dimensions) <= set(self.rows):
                order = sorted(
                    range(len(column.dimensions)), key=lambda i: self.rows.index(column.dimensions[i])
                )
                values = column.values.transpose(order)
                places = tuple(n if d in column.dimensions else 1 for d, n in zip(self.rows, shape))
                found[name] = np.broadcast_to(values.reshape(places), shape).ravel()
        return found


class Names:
    """Names of columns or symbols, none twice: what comes later gets underscores."""

    def __init__(self, taken: Iterable[str]) -> None:
        self._taken = set(taken)

    def __call__(self, name: str) -> str:
        while name in self._taken:
            name += "_"
        self._taken.add(name)
        return name


def names_of(flow: Any) -> Names:
    """Names with those of a flow's states, observables and parameters taken."""
    symbols = (*flow.states, *flow.observables, *flow.parameters)
    return Names([*(s.name for s in symbols), *([] if flow.epsilon is None else [str(flow.epsilon)])])


def quantities_of(flow: Any) -> list[str]:
    """Names of a flow's states and observables."""
    return [symbol.name for symbol in (*flow.states, *flow.observables)]


def constants_of(flow: Any, epsilon: float | None) -> dict[str, float]:
    """Epsilon, where there is one, and the parameters by name."""
    given = {} if flow.epsilon is None or epsilon is None else {str(flow.epsilon): float(epsilon)}
    return given | {symbol.name: float(value) for symbol, value in flow.parameters.items()}


def scalars(constants: Mapping[str, float]) -> dict[str, Column]:
    """Columns without dimensions."""
    return {name: Column((), np.array(value)) for name, value in constants.items()}


def library(name: str, use: str, *, extra: str = "tables") -> Any:
    """A library that is no necessary part, for what `use` says; raises `OutputError` where it is not installed.

    It comes with the `extra` of the package.
    """
    try:
        return importlib.import_module(name)
    except ImportError:
        raise OutputError(
            f"{use} {name}, which is not installed.", f"Install it with pip install 'gsp-toolkit[{extra}]'."
        ) from None


def texts(values: Iterable[object]) -> np.ndarray:
    """An array of text."""
    return np.array([str(value) for value in values], dtype=str)


def numbers(values: Iterable[float | None]) -> np.ndarray:
    """Doubles, nan for None."""
    return np.array([np.nan if value is None else float(value) for value in values])


def complexes(name: str, dimensions: tuple[str, ...], values: np.ndarray) -> dict[str, Column]:
    """Real and imaginary parts: JSON knows no complex numbers, and no frame's file does."""
    return {
        f"{name}_real": Column(dimensions, np.real(values)),
        f"{name}_imaginary": Column(dimensions, np.imag(values)),
    }


def _counted(name: str, size: int) -> Column:
    return Column((name,), np.arange(size))


def _written(columns: Mapping[str, Column]) -> dict[str, Any]:
    return {
        name: {"dimensions": list(c.dimensions), "shape": list(c.values.shape), "values": plain(c.values)}
        for name, c in columns.items()
    }
