"""The plots of the report that a reader can look into, from artifacts made up for the purpose."""

import json
import math
from types import SimpleNamespace

import numpy as np

from marsedl.papers.funnels.closeups import funnel
from marsedl.papers.powered_descent.closeups import final_states
from marsedl.papers.random_field.closeups import iterations
from marsedl.papers.random_field.records import Convergence


def made_up(**fields):
    """Stands for an artifact."""
    return SimpleNamespace(**{name: np.asarray(values) for name, values in fields.items()})


def closeup_data(function, **artifacts):
    data = function(**artifacts).data
    json.dumps(data, allow_nan=False)
    return data


def test_the_scatter_holds_the_trials_and_both_covariances():
    covariance = np.stack([np.eye(5), np.diag([4.0, 3.0, 2.0, 1.0, 0.5])])
    ensemble = made_up(final_state=np.arange(15.0).reshape(3, 5), mean=np.ones((2, 5)), covariance=covariance)
    gains = made_up(mean=np.zeros((2, 4)), covariance=covariance[:, :4, :4] * 2)
    closed, opened = closeup_data(final_states, gains=gains, closed_loop=ensemble, open_loop=ensemble)["cases"]
    assert closed["points"] == [[0.0, 1.0, 2.0, 3.0], [5.0, 6.0, 7.0, 8.0], [10.0, 11.0, 12.0, 13.0]]
    assert [ellipse["covariance"][0][0] for ellipse in closed["ellipses"]] == [8.0, 4.0]
    assert [ellipse["mean"][0] for ellipse in closed["ellipses"]] == [0.0, 1.0]
    assert [ellipse["name"] for ellipse in opened["ellipses"]] == ["of the trials"]


def test_the_slices_of_the_car_are_those_of_their_level_and_shape():
    car = made_up(
        state=np.zeros((9, 3)) + np.arange(9.0)[:, None] * [1.0, 2.0, math.radians(10.0)],
        funnel=["flow", "wind"],
        level=[[1.0, 4.0], [9.0, 9.0]],
        shape=np.tile(np.diag([2.0, 8.0, 2.0 / math.radians(1.0) ** 2]), (5, 1, 1)),
        slice_step=[0, 4],
        slice_time=[0.0, 0.4],
    )
    flights = made_up(kept_history=np.zeros((2, 5, 3)))
    data = closeup_data(funnel, dubins=car, dubins_calm=flights, dubins_wind=flights)
    assert data["centre"] == [[0.0, 0.0, 0.0], [8.0, 16.0, 80.0]]
    calm, windy = (np.array(case["half_axes"]) for case in data["cases"])
    np.testing.assert_allclose(calm, [np.diag([1.0, 0.5, 1.0]), np.diag([2.0, 1.0, 2.0])], atol=1e-3)
    np.testing.assert_allclose(windy[0], np.diag([3.0, 1.5, 3.0]), atol=1e-3)
    np.testing.assert_allclose(data["cases"][0]["flights"][1], [[0.0, 0.0, 0.0], [8.0, 16.0, 80.0]])


def test_the_histories_say_how_they_ended():
    rows = {name: [[1.0, 2.0], [3.0, math.nan]] for name in ("percentile", "percentile_error", "predicted", "apoapsis")}
    rows |= {name: [[1.0, 2.0], [3.0, 4.0]] for name in ("nominal_delta_v", "control_change", "lost")}
    rows |= {"variant": ["one_branch", "both"], "outcome": ["cycling", "converged"], "period": [2, 1]}
    convergence = Convergence(**{name: np.array(values) for name, values in rows.items()})
    data = closeup_data(iterations, convergence=convergence)
    assert data["series"] == ["one branch: cycling with period 2", "both: converged"]
    assert data["quantities"][0]["values"] == [[1.0, 2.0], [3.0, None]]
    assert data["quantities"][0]["errors"] == [[1.0, 2.0], [3.0, None]]
    assert [quantity["unit"] for quantity in data["quantities"]] == ["m/s", "m/s", "planet radii", "m/s", ""]
