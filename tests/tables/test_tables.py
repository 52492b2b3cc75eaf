"""Results as data sets, data frames and plain JSON: names, shapes and numbers are those of the result."""

from __future__ import annotations

import json
import sys

import numpy as np
import pandas
import pytest
import sympy as sp
import xarray

import gsp
from gsp.errors import OutputError
from gsp.results.registry import tables
from gsp.results.tabular import Tabular, table_of
from tests.cases import thinned
from tests.contracts import public
from tests.example_nouns import blank, hopf, michaelis
from tests.test_transport import CASES, noun

epsilon, x = sp.symbols("epsilon x")

TABULAR = [name for name in CASES if issubclass(getattr(gsp, name), Tabular)]


def nested(values: list, shape: list[int]) -> None:
    """Assert that lists are nested like an array of this shape."""
    if shape:
        assert len(values) == shape[0]
        for inner in values:
            nested(inner, shape[1:])


def test_what_has_a_table_is_tabular() -> None:
    assert {name for name in public("NOUNS") if tables.find(blank(getattr(gsp, name)))} == set(TABULAR)


@pytest.mark.exhaustive
@pytest.mark.parametrize("name", TABULAR)
def test_json_says_dimensions_shapes_and_values(name: str) -> None:
    content = json.loads(json.dumps(noun(name).as_json(), allow_nan=False))
    assert content["what"] == name
    columns = {**content["coordinates"], **content["variables"]}
    assert len(columns) == len(content["coordinates"]) + len(content["variables"])
    for column in columns.values():
        assert column["shape"] == [content["dimensions"][d] for d in column["dimensions"]]
        nested(column["values"], column["shape"])
    assert content["variables"]


@pytest.mark.exhaustive
@pytest.mark.parametrize("name", TABULAR)
def test_a_dataset_holds_what_json_says(name: str) -> None:
    result = noun(name)
    content, data = result.as_json(), result.to_xarray()
    assert isinstance(data, xarray.Dataset)
    assert dict(data.sizes) == content["dimensions"]
    assert set(data.variables) == {*content["coordinates"], *content["variables"]}
    assert set(data.data_vars) == set(content["variables"])
    assert data.attrs["what"] == name
    for part in ("coordinates", "variables"):
        for label, column in content[part].items():
            values = data[label].values
            assert list(data[label].dims) == column["dimensions"]
            if values.dtype.kind == "f":
                expected = np.array(column["values"], dtype=float)
                np.testing.assert_array_equal(np.where(np.isfinite(values), values, np.nan), expected)
            else:
                assert values.tolist() == column["values"]


@pytest.mark.parametrize("name", thinned(TABULAR, 2))
def test_a_frame_has_a_row_for_each_place_of_its_grid(name: str) -> None:
    result = noun(name)
    frame, data = result.to_pandas(), result.to_xarray()
    assert isinstance(frame, pandas.DataFrame)
    assert frame.attrs["what"] == name
    table = table_of(result)
    if table.records is None:
        assert len(frame) == np.prod([data.sizes[d] for d in table.rows])
        frame = frame.reset_index()
        grid = xarray.Dataset(coords={d: np.arange(data.sizes[d]) for d in table.rows})
        for label in set(frame) & set(data.data_vars):
            values = (
                data[label]
                .drop_vars(list(data[label].coords))
                .broadcast_like(grid)
                .transpose(*table.rows)
                .values
            )
            np.testing.assert_array_equal(frame[label].to_numpy(values.dtype), values.ravel())
    else:
        assert len(frame) == len(table.records)
    assert len(table.as_rows()) == len(frame)


def test_a_trajectory_by_name() -> None:
    run = noun("Trajectory")
    frame, data = run.to_pandas(), run.to_xarray()
    assert frame.index.name == "t"
    assert list(frame.columns) == [s.name for s in (*run.flow.states, *run.flow.observables)]
    np.testing.assert_array_equal(frame["s"].to_numpy(), run["s"])
    np.testing.assert_array_equal(data.s.values, run["s"])
    assert float(data.epsilon) == run.epsilon
    assert float(data.kappa) == float(run.flow.parameters[sp.Symbol("kappa")])
    assert data.attrs["status"] == "SUCCESS"


def test_events_lie_along_a_dimension_of_their_own() -> None:
    run = gsp.integrate(
        michaelis(),
        events=[gsp.Event(sp.Symbol("s") - level, name=f"at_{k}") for k, level in enumerate((0.8, 0.5))],
    )
    data = run.to_xarray()
    assert data.event.values.tolist() == ["at_0", "at_1"]
    np.testing.assert_array_equal(data.event_t.values, [run.events[n].times[0] for n in ("at_0", "at_1")])
    np.testing.assert_allclose(data.event_s.values, [0.8, 0.5], rtol=1e-8)
    assert len(run.to_pandas()) == run.t.size


def test_a_singular_orbit_by_point_and_piece() -> None:
    orbit = noun("SingularOrbit")
    data, frame = orbit.to_xarray(), orbit.to_pandas()
    np.testing.assert_array_equal(data.x.values, np.concatenate([piece.run["x"] for piece in orbit.pieces]))
    assert data.duration.values.tolist() == [piece.duration for piece in orbit.pieces]
    assert np.all(np.diff(data.t.values) >= 0.0)
    assert data.t.values[-1] == pytest.approx(sum(piece.duration for piece in orbit.pieces))
    folds = [np.nan if piece.fold is None else piece.fold.point["x"] for piece in orbit.pieces]
    np.testing.assert_array_equal(data.fold_x.values, folds)
    # A drop changes the fast variable alone, and the next piece begins where it lands.
    begins = [piece.run["x"][0] for piece in orbit.pieces[1:]]
    np.testing.assert_allclose(data.landing_x.values[: len(begins)], begins, rtol=1e-6)
    np.testing.assert_array_equal(data.landing_y.values, data.fold_y.values)
    assert data.attrs["T_0"] == orbit.coefficients[0]
    assert len(frame) == data.sizes["point"]


def test_swings_are_rows_and_a_passage_has_its_numbers() -> None:
    mode = noun("MixedMode")
    frame = mode.to_pandas()
    assert frame["size"].tolist() == mode.sizes.tolist()
    assert frame["t"].tolist() == mode.times.tolist()
    assert frame.attrs["signature"] == mode.signature
    passage = noun("FoldPassage")
    data = passage.to_xarray()
    assert data.leading.values.tolist() == passage.leading.tolist()
    assert data.slow.values.tolist() == [s.name for s in passage.system.x]
    assert data.fast_fold.values.tolist() == passage.y0.tolist()
    assert (data.attrs["a"], data.attrs["b"]) == (passage.a, passage.b)


def test_an_ensemble_by_member_and_time() -> None:
    flow = michaelis().system
    runs = gsp.integrate_many(
        flow, {"s": [1.0, 0.5, 0.2], "c": 0.0}, span=(0.0, 1.0), epsilon=[0.01, 0.02, 0.03], at=[0.5, 1.0]
    )
    frame, data = runs.to_pandas(), runs.to_xarray()
    assert frame.index.names == ["member", "t"]
    assert frame.loc[(1, 0.5), "s"] == runs["s"][1, 0]
    assert frame.loc[(2, 1.0), "epsilon"] == 0.03
    assert data.s.sel(member=2, t=1.0).item() == runs["s"][2, 1]
    assert data.start_s.values.tolist() == [1.0, 0.5, 0.2]
    assert data.status.values.tolist() == ["SUCCESS"] * 3


def test_a_comparison_by_order_and_epsilon() -> None:
    found = noun("Comparison")
    data, frame = found.to_xarray(), found.to_pandas()
    for n in found.errors:
        for i, e in enumerate(found.epsilons):
            assert data.error.sel(order=n, epsilon=e).item() == found.errors[n][i]
            assert frame.loc[(n, e), "error"] == found.errors[n][i]
            assert frame.loc[(n, e), "slope"] == pytest.approx(found.slopes[n], nan_ok=True)
            assert frame.loc[(n, e), "floor"] == found.floor[i]


def test_claims_have_a_table_of_their_own() -> None:
    found = gsp.compare(gsp.models.load("chaplygin_sleigh"), orders=(0,), epsilons=(0.02, 0.01))
    data = found.to_xarray()
    for name, errors in found.claims.items():
        assert tuple(data.claim_error.sel(claim=name).values) == errors
    assert "claim_error" not in found.to_pandas()


def test_an_orbit_and_its_family() -> None:
    orbit = noun("PeriodicOrbit")
    data = orbit.to_xarray()
    np.testing.assert_array_equal(data.multiplier_real.values, orbit.multipliers.real)
    assert data.t.values[-1] == orbit.period
    family = noun("OrbitFamily")
    frame = family.to_pandas()
    np.testing.assert_array_equal(frame["a"].to_numpy(), family["a"])
    np.testing.assert_array_equal(frame["period"].to_numpy(), family.period)
    np.testing.assert_array_equal(frame["maximum_x"].to_numpy(), family.maximum("x"))
    assert float(family.to_xarray().epsilon) == hopf().epsilon


def test_a_choice_by_model() -> None:
    found = noun("Choice")
    frame = found.to_pandas()
    assert frame.index[frame["chosen"]].tolist() == [found.model.label]
    assert frame.loc[found.model.label, "predicted"] == found.predicted
    assert frame.attrs["answer"] == str(found.verdict.answer)


def test_names_that_are_taken_get_an_underscore() -> None:
    t, member, status = sp.symbols("t member status")
    flow = gsp.VectorField(states={t: sp.Integer(1), member: -member, status: -status}, epsilon=None)
    start = {"t": 0.0, "member": 1.0, "status": 2.0}
    run = gsp.integrate(flow, start=start, span=(0.0, 1.0), at=[0.0, 1.0])
    data = run.to_xarray()
    assert data.t.dims == ("t_",)
    assert run.to_pandas().index.name == "t_"
    runs = gsp.integrate_many(flow, start, span=(0.0, 1.0)).to_xarray()
    assert runs.member.dims == ("member_", "t_")
    assert runs.status_.values.tolist() == ["SUCCESS"]


def test_nan_and_infinity_are_null() -> None:
    runs = gsp.integrate_many(
        gsp.VectorField(states={x: x**2}, epsilon=None), {"x": [1.0, 0.1]}, span=(0.0, 2.0), at=[0.5, 2.0]
    )
    assert np.isnan(runs["x"][0, 1])
    values = runs.as_json()["variables"]["x"]["values"]
    assert values[0][1] is None
    assert values[1] == runs["x"][1].tolist()


@pytest.mark.parametrize(("verb", "library"), [("to_pandas", "pandas"), ("to_xarray", "xarray")])
def test_what_is_not_installed_is_named(verb: str, library: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, library, None)
    with pytest.raises(OutputError, match=rf"{library}, which is not installed.*gsp-toolkit\[tables\]"):
        getattr(noun("Comparison"), verb)()
    assert noun("Comparison").as_json()["what"] == "Comparison"
