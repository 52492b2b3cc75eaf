"""Results that are tables or grids: as pandas, xarray or plain JSON, with names and shapes, made when asked for."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from gsp.results import registry
from gsp.results.files import write_rows

if TYPE_CHECKING:
    from gsp.results.table import Table


class Tabular:
    """Gives a result its labelled arrays. Nothing is imported before they are asked for.

    Names that a state or a parameter has taken already get an underscore behind them.
    """

    __slots__ = ()

    def to_xarray(self) -> Any:
        """The result as an `xarray.Dataset`: variables with named dimensions, coordinates, and `attrs` for the rest.

        Raises `OutputError` where xarray is not installed.
        """
        return table_of(self).to_xarray()

    def to_pandas(self) -> Any:
        """The result as a `pandas.DataFrame`, indexed by the dimensions of its main quantities.

        Quantities of other dimensions are left out; `to_xarray` has them. Raises `OutputError` where pandas is not
        installed.
        """
        return table_of(self).to_pandas()

    def as_json(self) -> dict[str, Any]:
        """The result in plain values, which `json.dumps` takes as they are: nan and infinity are None.

        `dimensions` maps names to lengths; under `coordinates` and `variables` every name has its `dimensions`, its
        `shape` and its `values`, nested lists in row-major order; `attributes` are text and numbers.
        """
        return table_of(self).as_json()

    def as_rows(self) -> list[Mapping[str, object]]:
        """The rows of the data frame, each a dictionary of numbers and text."""
        return table_of(self).as_rows()

    def write_csv(self, path: str | Path) -> Path:
        """Write the rows to `path`; raises `OutputError` when that cannot be done."""
        return write_rows(self.as_rows(), path)


def table_of(result: Tabular) -> Table:
    """The table of a result, as its package makes it."""
    make = registry.tables.find(result)
    assert make is not None, f"the package of {type(result).__name__} gives it no table"
    return make(result)
