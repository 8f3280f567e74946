"""What is said of arguments that do not fit."""

import numpy as np
import pytest

from marsedl.methods import checks


@pytest.mark.parametrize(
    ("check", "said"),
    [
        (lambda: checks.require_shape("gain", np.ones((3, 4)), ("N", 5), ", by state"),
         "gain must have shape (N, 5), by state, not (3, 4)"),
        (lambda: checks.require_shape("step", np.ones((2, 1)), (2,)), "step must have shape (2,), not (2, 1)"),
        (lambda: checks.require_shape("step", 1.0, ("N",)), "step must have shape (N,), not ()"),
        (lambda: checks.require_array("step", np.array([[0.0, np.nan]]), (1, 2)),
         "step has entries that are not finite, the first at [0, 1]"),
        (lambda: checks.require_values("the function", np.array([1.0, np.inf]), 2),
         "the function must return 2 finite values, one for each point, not an array (2,) with 1 that are not finite"),
        (lambda: checks.require_positive("scales", [1.0, 0.0]), "scales must be positive; entry 1 is 0"),
        (lambda: checks.require_at_least("order", 0, 1), "order must be at least 1, not 0"),
        (lambda: checks.require_one_of("form", "other", ("first", "second")),
         "form must be one of first, second, not 'other'"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_said_with_its_name(check, said):
    with pytest.raises(ValueError) as refused:
        check()
    assert str(refused.value) == said


def test_what_fits_is_accepted():
    checks.require_array("gain", np.zeros((3, 5)), ("N", 5))
    checks.require_array("empty", np.zeros((0, 2)), ("N", 2))
    checks.require_values("the function", [1.0, 2.0], 2)
    checks.require_positive("scales", np.array([1e-300, 2.0]))
    checks.require_at_least("order", 1, 1)
    checks.require_one_of("form", "first", ("first",))
