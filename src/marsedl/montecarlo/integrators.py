"""Fixed-step integrators over a group of trials, for ordinary and for additive-noise stochastic differential equations.

`flights` binds a scheme to a model, whose `rates` it calls for every lane of a group. To a scheme the model is a
compiled function `drift(half_index, state, noise, parameters, out)`:

- half_index: position in the tables, which are sampled on the half-step grid: step k goes from 2 k to 2 k + 2;
- state: (n, LANES); noise: (m, LANES), white noise held over the step = Brownian increment / step;
- parameters: whatever the drift needs, a tuple;
- out: (n, LANES), the time derivative of the state, written.

A scheme takes the drift and returns the compiled function
`advance(step_index, step, state, noise, parameters, work)` of one step:

- step_index: k; step: h, s; state: (n, LANES), updated in place; noise, parameters: passed on to the drift;
- work: three scratch arrays (n, LANES).

The drift is bound here, once, because compiled functions that travel as arguments defeat numba's on-disk cache.

All schemes have strong order 1 with additive noise, as the noise enters only by its increment over the step. They
differ in the deterministic part: order 4 against order 1, which is also the weak order of both Euler schemes.
"""

END_ITERATIONS = 60  # for the zero of `ended`: more than the few that a smooth flight needs


def narrowed(bracket, part, excess):
    """The bracket (lower, upper, both excesses, the side kept last) of a zero, with one end moved to a part of a step.

    Regula falsi, where an end that is kept twice counts half (Illinois, Dowell and Jarratt 1971).
    """
    lower, upper, above, below, last_side = bracket
    if excess > 0.0:
        return part, upper, excess, 0.5 * below if last_side > 0.0 else below, 1.0
    return lower, part, 0.5 * above if last_side < 0.0 else above, excess, -1.0


def runge_kutta_4(drift):
    """Classical Runge-Kutta step: x <- x + h/6 (k1 + 2 k2 + 2 k3 + k4).

    The drift is evaluated at the half indices 2k, 2k + 1, 2k + 1, 2k + 2. Takes the drift and
    returns `advance`, see the module.
    """

    from marsedl.montecarlo.lanes import LANES, inline_called_njit

    @inline_called_njit
    def advance(step_index, step, state, noise, parameters, work):
        stage, slope, total = work
        rows = state.shape[0]
        half = 0.5 * step
        sixth = step / 6.0
        drift(2 * step_index, state, noise, parameters, slope)
        for row in range(rows):
            for lane in range(LANES):
                total[row, lane] = slope[row, lane]
                stage[row, lane] = state[row, lane] + half * slope[row, lane]
        drift(2 * step_index + 1, stage, noise, parameters, slope)
        for row in range(rows):
            for lane in range(LANES):
                total[row, lane] += 2.0 * slope[row, lane]
                stage[row, lane] = state[row, lane] + half * slope[row, lane]
        drift(2 * step_index + 1, stage, noise, parameters, slope)
        for row in range(rows):
            for lane in range(LANES):
                total[row, lane] += 2.0 * slope[row, lane]
                stage[row, lane] = state[row, lane] + step * slope[row, lane]
        drift(2 * step_index + 2, stage, noise, parameters, slope)
        for row in range(rows):
            for lane in range(LANES):
                state[row, lane] += sixth * (total[row, lane] + slope[row, lane])

    return advance


def euler_maruyama(drift):
    """Euler-Maruyama step: x <- x + h f(x, increment / h), exact in the noise when the drift is linear in it.

    The drift is evaluated at the half index 2k. Takes the drift, returns `advance`: see the module.
    """

    from marsedl.montecarlo.lanes import LANES, inline_called_njit

    @inline_called_njit
    def advance(step_index, step, state, noise, parameters, work):
        _, slope, _ = work
        drift(2 * step_index, state, noise, parameters, slope)
        for row in range(state.shape[0]):
            for lane in range(LANES):
                state[row, lane] += step * slope[row, lane]

    return advance


def semi_implicit_euler(positions):
    """Euler step that moves the positions by the new velocities: v <- v + h f(x, v), then x <- x + h g(x, v).

    The first `positions` rows of the state are the positions x, all others count as velocities v; with `x' = v` this is
    the symplectic Euler scheme. The drift is evaluated twice at the half index 2k, with the old and with the new
    velocities. Returns the scheme, which takes the drift and returns `advance`: see the module.
    """

    def scheme(drift):
        from marsedl.montecarlo.lanes import LANES, inline_called_njit

        @inline_called_njit
        def advance(step_index, step, state, noise, parameters, work):
            _, slope, _ = work
            drift(2 * step_index, state, noise, parameters, slope)
            for row in range(positions, state.shape[0]):
                for lane in range(LANES):
                    state[row, lane] += step * slope[row, lane]
            drift(2 * step_index, state, noise, parameters, slope)
            for row in range(positions):
                for lane in range(LANES):
                    state[row, lane] += step * slope[row, lane]

        return advance

    scheme.positions = positions
    return scheme
