"""The compiled flight of a group of trials: loops over lanes, the root of the end, noise, air and what is stored."""

import numpy as np

from marsedl.montecarlo.flights.addressed import call_at
from marsedl.montecarlo.flights.binding import asked, compiled
from marsedl.montecarlo.flights.columns import borrowed, dresser, getter, putter
from marsedl.montecarlo.integrators import END_ITERATIONS, narrowed
from marsedl.montecarlo.lanes import LANES, called_njit, inline_called_njit, lane_array
from marsedl.montecarlo.outcomes import MET_AT_THE_START, NOTHING
from marsedl.montecarlo.streams import NORMALS_PER_BLOCK, fill_normals, fill_one_normal


def fly_groups(p, law, pace, draws, sizes, groups, start, vehicle, memory, given_air, results):
    """Fly whole groups; this function is compiled and cached under the name of what is bound to it."""
    seed, first_trial, increments, first_increment, noise_stream, air_stream, navigation_stream, only = draws
    nodes, remembered = sizes
    air, past = np.empty((nodes, LANES)), np.empty((remembered, LANES))
    for number in range(groups[0], groups[1]):
        streams = (noise_stream, air_stream, navigation_stream)
        here = (seed, first_trial + number * LANES, increments, first_increment, *streams, only)
        _bound(p, law, pace, here, number * LANES, start, vehicle, memory, given_air, results, air, past)  # noqa: F821


_narrowed = inline_called_njit(narrowed)


def group_flight(model, key, p_shape, law_shape, kinds, by_address):
    """Compile (lazily) the flight of LANES trials of a `Flight`, its parameters and law being of these shapes.

    Loops over lanes call one function of the model each, so that they become vector code; look-ups and `consult` have
    loops of their own. Conditions of the model, such as `ends`, are constants to the compiler.

    kinds: named tuples of its parts, by name. by_address: whether its law is compiled alone, see `addressed`; then
    `law` is the address, and the words of the parameters of law and model.

    key: digest of all that is compiled. What is called carries it in its name: kernels that other processes compiled
    and cached meet in one, where of two symbols of the same name the first serves both.
    """

    def named_njit(function):
        function.__qualname__ += f"_{key}"
        return called_njit(function)

    end_tolerance, watch_steps = model.options["end_tolerance"], model.options["watch_steps"]

    @inline_called_njit
    def absent(*unused):
        pass

    def loop(role, **options):
        function = model.functions[role]
        return compiled(function, role, kinds, **options) if function else absent

    rates, rates_of_one = loop("rates"), loop("rates", single=True)
    actuate, actuate_one = loop("actuate"), loop("actuate", single=True)
    look_up, look_up_one = loop("look_up"), loop("look_up", single=True)
    ended, ended_one = loop("ended"), loop("ended", single=True)
    sense, sense_one = loop("sense"), loop("sense", single=True)
    phase, interrupts = loop("phase"), loop("interrupts")
    navigate = loop("navigate", masked=True)
    consult = absent if by_address else loop("consult")
    watch, store, observe, finish = loop("watch", masked=True), loop("store"), loop("observe"), loop("finish")
    guides = () if by_address else tuple(compiled(function, "guide", kinds, masked=True) for function in model.guides)
    vary = loop("vary")
    get_drawn, put_drawn = getter(kinds["drawn"]), putter(kinds["drawn"], model.functions["vary"] or absent.py_func)
    ends, varies, watches, interrupted_by, navigates = (
        model.functions[role] is not None for role in ("ended", "vary", "watch", "interrupts", "navigate")
    )
    phases, finds_root = len(model.guides), model.classes.get("ended") is not bool
    judged = asked(model.functions["ended"], "ended") if ends else ()
    looks_back = "before" in asked(model.functions["rates"], "rates")
    judges_sensed = "sensed" in judged
    judges_found = judges_sensed or "found" in judged
    STATES, FOUND, SENSED, NAV, DRAWS, ADVICE, COMMANDS, VEHICLE, NOISES, DRAWN, WATCHED, STORED, OBSERVED, FINAL = (
        len(kinds[name]._fields)
        for name in (
            *("state", "found", "sensed", "nav", "draws", "advice", "command", "vehicle", "noise", "drawn"),
            *("watched", "stored", "observed", "final"),
        )
    )
    MOVED, actuates = len(kinds["flown"]._fields), model.functions["actuate"] is not None
    dress_p, dress_law = dresser(p_shape), dresser(law_shape)

    @inline_called_njit
    def drift(half_index, state, noise, parameters, out):
        time, base, step, before, found, command, vehicle, air, p, known, moved, moved_at = parameters
        now = time + 0.5 * step * (half_index - base)
        if known[0, 0] == 0.0:
            look_up(half_index, now, state, air, p, found)
        known[0, 0] = 0.0  # what was looked up at the start of a step serves its first stage
        if actuates and moved_at[0, 0] != now:  # as two stages in the middle of a step, and its end and the next start
            actuate(half_index, now, command, vehicle, p, moved)
            moved_at[0, 0] = now
        rates(half_index, now, before, step, state, found, command, moved, vehicle, noise, p, out)

    advance = model.options["integrator"](drift)

    @named_njit
    def step_lane(part, lane, parameters, noise, state, slope, end):
        """Fly a part of a Runge-Kutta step of a single lane to `end`."""
        time, base, step, before, found, command, vehicle, air, p, _, moved, _ = parameters
        for row in range(STATES):
            slope[row, lane] = 0.0
        for stage in range(4):
            ahead = 0.0 if stage == 0 else (1.0 if stage == 3 else 0.5)
            for row in range(STATES):
                state[row, lane] = before[row, lane] + ahead * part * slope[row, lane]
            now, half_index = time + ahead * part, base + int(2.0 * ahead)
            look_up_one(lane, half_index, now, state, air, p, found)
            actuate_one(lane, half_index, now, command, vehicle, p, moved)
            rates_of_one(lane, half_index, now, before, step, state, found, command, moved, vehicle, noise, p, slope)
            weight = part / 6.0 if stage in (0, 3) else part / 3.0
            for row in range(STATES):
                end[row, lane] = (before[row, lane] if stage == 0 else end[row, lane]) + weight * slope[row, lane]

    @named_njit
    def sense_at(lane, now, half_index, state, found, command, vehicle, air, p, sensed):
        """What is looked up and sensed in a single lane at a time of its own."""
        look_up_one(lane, half_index, now, state, air, p, found)
        sense_one(lane, half_index, now, state, found, command, vehicle, p, sensed)

    @named_njit
    def excess_of(lane, now, half_index, state, found, sensed, parameters, excess):
        """Evaluate `ended` for a single lane, and what it asks for."""
        command, vehicle, air, p = parameters[5:9]
        if judges_sensed:
            sense_at(lane, now, half_index, state, found, command, vehicle, air, p, sensed)
        elif judges_found:
            look_up_one(lane, half_index, now, state, air, p, found)
        ended_one(lane, now, state, found, sensed, vehicle, p, excess)

    @named_njit
    def to_end(lane, parameters, noise, state, slope, end, sensed, excess):
        """Fly the part of a step after which `ended` is zero, and return it; `end` was the end of the whole step."""
        time, base, step, before, found = parameters[:5]
        excess_of(lane, time, base, before, found, sensed, parameters, excess)
        part, above = step, excess[0, lane]
        excess_of(lane, time + step, base + 2, end, found, sensed, parameters, excess)
        bracket = (0.0, step, above, excess[0, lane], 0.0)
        if above <= 0.0:  # it began behind its end
            step_lane(0.0, lane, parameters, noise, state, slope, end)
            return 0.0
        for _ in range(END_ITERATIONS):
            lower, upper, above, below, _ = bracket
            part = (lower * below - upper * above) / (below - above)
            step_lane(part, lane, parameters, noise, state, slope, end)
            excess_of(lane, time + part, base + 2, end, found, sensed, parameters, excess)
            if abs(excess[0, lane]) <= end_tolerance:
                break
            bracket = _narrowed(bracket, part, excess[0, lane])
        return part

    @inline_called_njit
    def fill(seed, stream, first_trial, block, bits, only, first, out):
        if only.shape[1] == 0:
            fill_normals(seed, stream, first_trial, block, bits, out)
        else:
            fill_one_normal(stream, block, only, first, out)

    @named_njit
    def sample_air(seed, stream, first_trial, only, first, table, drawn_after, p):
        """The trials' own air, node by node from the last down, one normal a node."""
        bits = lane_array(NORMALS_PER_BLOCK).view(np.uint64)
        normal_numbers, drawn, value = lane_array(NORMALS_PER_BLOCK), lane_array(DRAWN), lane_array(1)
        for row in range(DRAWN):
            for lane in range(LANES):
                drawn[row, lane] = 0.0
        top = table.shape[0] - 1
        for number in range(top + 1):
            position, node = number % NORMALS_PER_BLOCK, top - number
            if position == 0:
                fill(seed, stream, first_trial, number // NORMALS_PER_BLOCK, bits, only, first, normal_numbers)
            for lane in range(LANES):
                value[0, lane], after = vary(node, normal_numbers[position, lane], get_drawn(drawn, lane), p)
                put_drawn(after, drawn, lane, None)
            for lane in range(LANES):
                table[node, lane] = value[0, lane]
        for row in range(DRAWN):
            for lane in range(LANES):
                drawn_after[row, lane] = drawn[row, lane]

    @named_njit
    def draw_for(cycle, seed, stream, first_trial, bits, only, first, filled, block_of_draws, draws):
        """The normals that navigation gets in a guidance period; `draws` is filled. Returns the last block of them."""
        for component in range(DRAWS):
            number = cycle * DRAWS + component
            block, position = number // NORMALS_PER_BLOCK, number % NORMALS_PER_BLOCK
            if block != filled:
                fill(seed, stream, first_trial, block, bits, only, first, block_of_draws)
                filled = block
            for lane in range(LANES):
                draws[component, lane] = block_of_draws[position, lane]
        return filled

    def steering(number):
        """The compiled guidance of the phases from `number` on; one that no trial needs is not computed."""
        if number == phases:
            return absent
        guide, later = guides[number], steering(number + 1)

        @inline_called_njit
        def steer(scene, command, chosen, in_phase, turns):
            needed = 0
            for lane in range(LANES):
                turns[0, lane] = chosen[0, lane] * (in_phase[0, lane] == number if phases > 1 else 1.0)
                needed += turns[0, lane] > 0.0
            if needed > 0:
                guide(*scene, command, turns)
            later(scene, command, chosen, in_phase, turns)

        return steer

    @inline_called_njit
    def steer_at(scene, command, chosen, in_phase, turns):
        half_index, time, cycle, state, found, share, sensed, nav, _, memory, past, vehicle, law, _ = scene
        address, law_words, p_words = law
        parts = (state, found, sensed, nav, memory, vehicle, past, command, chosen)
        call_at(address, (half_index, cycle, time, share, *parts, law_words, p_words))

    steer = steer_at if by_address else steering(0)

    @named_njit
    def fly_group(
        p_values, law_values, pace, draws, first, starts, vehicles, memories, given_air, results, table, pasts
    ):
        p, law, air, past = dress_p(p_values), dress_law(law_values), borrowed(table), borrowed(pasts)
        cycle_start, cycle_step, cycle_steps, every, stores_end = pace
        seed, first_trial, increments, first_increment, noise_stream, air_stream, navigation_stream, only = draws
        history, observed, stored_watched, length, stored_final, ended_by = results
        only, rows_stored = borrowed(only), min(STORED, history.shape[1])
        state, before, at_end = lane_array(STATES), lane_array(STATES), lane_array(STATES)
        work = (lane_array(STATES), lane_array(STATES), lane_array(STATES))
        found, sensed, advice, command = lane_array(FOUND), lane_array(SENSED), lane_array(ADVICE), lane_array(COMMANDS)
        vehicle, noise, drawn = lane_array(VEHICLE), lane_array(NOISES), lane_array(DRAWN)
        nav, drawn_now, block_of_draws = lane_array(NAV), lane_array(DRAWS), lane_array(NORMALS_PER_BLOCK)
        memory = lane_array(len(memories))  # of laws by address as much as each remembers
        watched, final, stored, seen = lane_array(WATCHED), lane_array(FINAL), lane_array(STORED), lane_array(OBSERVED)
        flying, chosen, guided, in_phase = lane_array(1), lane_array(1), lane_array(1), lane_array(1)
        turns, is_due, excess, end_time = lane_array(1), lane_array(1), lane_array(2), lane_array(1)
        end_index, end_cycle = np.zeros((1, LANES), np.int64), np.zeros((1, LANES), np.int64)
        bits, moved = lane_array(NORMALS_PER_BLOCK).view(np.uint64), lane_array(MOVED)
        known, moved_at, judged_at = lane_array(1), lane_array(1), np.nan
        moved_at[0, 0] = np.nan
        block_of_normals, filled_block, number = lane_array(NORMALS_PER_BLOCK), -1, first_increment * NOISES
        block_drawn = np.int64(-1)
        for row in range(DRAWN):
            for lane in range(LANES):
                drawn[row, lane] = 0.0  # stays, if air is given
        if varies and given_air.shape[0] == 0:
            sample_air(seed, air_stream, first_trial, only, first, air, drawn, p)
        for node in range(given_air.shape[0]):
            for lane in range(LANES):
                air[node, lane] = given_air[node, first + lane]
        for lane in range(LANES):
            for row in range(STATES):
                state[row, lane] = starts[row, first + lane]
            for row in range(VEHICLE):
                vehicle[row, lane] = vehicles[row, first + lane]
            for row in range(WATCHED):
                watched[row, lane] = stored_watched[row, first + lane]
            for row in range(len(memories)):
                memory[row, lane] = memories[row]
            for row in range(COMMANDS):
                command[row, lane] = 0.0
            for row in range(NAV):
                nav[row, lane] = 0.0
            flying[0, lane], guided[0, lane], in_phase[0, lane] = 1.0, 0.0, 0.0
            excess[1, lane], ended_by[first + lane] = 0.0, NOTHING
        if ends:
            if judges_found:
                look_up(0, cycle_start[0], state, air, p, found)
            if judges_sensed:
                sense(0, cycle_start[0], state, found, command, vehicle, p, sensed)
            ended(cycle_start[0], state, found, sensed, vehicle, p, excess)
            for lane in range(LANES):
                behind = excess[0, lane] <= 0.0 if finds_root else excess[0, lane] != 0.0
                ended_by[first + lane] = MET_AT_THE_START if behind else NOTHING

        # Not literals: what is called with them would be compiled for the literal, and once more for any integer.
        cycle, substep, flown, remaining = np.int64(0), np.int64(0), np.int64(0), np.int64(LANES)
        while True:
            over = remaining == 0 or cycle == len(cycle_step)
            step = cycle_step[min(cycle, len(cycle_step) - 1)]
            time, half_index = cycle_start[cycle] + substep * step, 2 * flown
            if over and ends:
                for row in range(STATES):
                    for lane in range(LANES):
                        state[row, lane] = state[row, lane] if flying[0, lane] > 0.0 else at_end[row, lane]
            stores, guides_now = flown % every == 0 and not over, False
            if phases > 0 and not over:
                if substep == 0:
                    guides_now = True
                    for lane in range(LANES):
                        chosen[0, lane] = flying[0, lane]
                elif interrupted_by:
                    interrupts(time, state, memory, vehicle, law, p, is_due)
                    due = 0
                    for lane in range(LANES):
                        chosen[0, lane] = flying[0, lane] * is_due[0, lane]
                        due += chosen[0, lane] > 0.0
                    guides_now = due > 0
            is_known = time == judged_at and not over  # what a step was judged by at its end serves the next one
            if stores or over:
                for lane in range(LANES):
                    if flying[0, lane] > 0.0:
                        end_time[0, lane], end_index[0, lane], end_cycle[0, lane] = time, half_index, cycle
            if over:
                for lane in range(LANES):
                    now, index = end_time[0, lane], end_index[0, lane]
                    sense_at(lane, now, index, state, found, command, vehicle, air, p, sensed)
            elif stores or guides_now or watch_steps:
                if not is_known:
                    look_up(half_index, time, state, air, p, found)
                if not (is_known and judges_sensed):
                    sense(half_index, time, state, found, command, vehicle, p, sensed)
                is_known = True
            known[0, 0] = 1.0 if is_known else 0.0
            if guides_now:
                if navigates and substep == 0:
                    drawing = (seed, navigation_stream, first_trial, bits, only, first)
                    block_drawn = draw_for(cycle, *drawing, block_drawn, block_of_draws, drawn_now)
                    navigate(cycle, time, sensed, nav, drawn_now, vehicle, p, chosen)
                consult(cycle, time, sensed, nav, memory, vehicle, law, p, advice)
                if phases > 1:
                    phase(cycle, time, sensed, nav, memory, vehicle, law, p, in_phase)
                place = (half_index, time, cycle, state, found, substep / cycle_steps[cycle])
                scene = (*place, sensed, nav, advice, memory, past, vehicle, law, p)
                steer(scene, command, chosen, in_phase, turns)
                moved_at[0, 0] = np.nan
                for lane in range(LANES):
                    guided[0, lane] = 1.0 if chosen[0, lane] > 0.0 else guided[0, lane]
            if watches and (watch_steps or guides_now):
                ending, asked = 1.0 if over else 0.0, flying if watch_steps else chosen
                seen_by = (half_index, time, cycle, state, found, guided, sensed, nav, command, memory, vehicle, p)
                watch(watched, ending, *seen_by, asked)
            if stores or (over and stores_end):
                stored_row = history.shape[0] - 1 if over else flown // every
                place = (end_index, end_time, end_cycle)
                seen_by = (state, found, guided, sensed, nav, command, memory, vehicle, p)
                store(*place, *seen_by, stored)
                observe(*place, *seen_by, seen)
                # Row by row: what is written to many rows at once waits for memory. Unsigned: an index that may be
                # negative makes scattered stores.
                for row in range(rows_stored):
                    for lane in range(LANES):
                        history[stored_row, row, np.uint64(first) + np.uint64(lane)] = stored[row, lane]
                for row in range(OBSERVED):
                    for lane in range(LANES):
                        observed[stored_row, row, np.uint64(first) + np.uint64(lane)] = seen[row, lane]
                for lane in range(LANES):
                    guided[0, lane] = 0.0 if flying[0, lane] > 0.0 else guided[0, lane]
            if over:
                break

            if NOISES > 0:
                scale = np.sqrt(step / increments) / step
                for component in range(NOISES):
                    for lane in range(LANES):
                        noise[component, lane] = 0.0
                for _ in range(increments):
                    for component in range(NOISES):
                        block = number // NORMALS_PER_BLOCK
                        if block != filled_block:
                            fill(seed, noise_stream, first_trial, block, bits, only, first, block_of_normals)
                            filled_block = block
                        position = number % NORMALS_PER_BLOCK
                        for lane in range(LANES):
                            noise[component, lane] += block_of_normals[position, lane]
                        number += 1
                for component in range(NOISES):
                    for lane in range(LANES):
                        noise[component, lane] *= scale

            parameters = (time, half_index, step, before, found, command, vehicle, air, p, known, moved, moved_at)
            if ends or looks_back:
                for row in range(STATES):
                    for lane in range(LANES):
                        before[row, lane] = state[row, lane]
            advance(flown, step, state, noise, parameters, work)
            if ends:
                if judges_found:
                    judged_at = time + step
                    look_up(half_index + 2, judged_at, state, air, p, found)
                if judges_sensed:
                    sense(half_index + 2, time + step, state, found, command, vehicle, p, sensed)
                ended(time + step, state, found, sensed, vehicle, p, excess)
                reached = 0
                for lane in range(LANES):
                    behind = excess[0, lane] <= 0.0 if finds_root else excess[0, lane] != 0.0
                    chosen[0, lane] = flying[0, lane] * behind
                    reached += chosen[0, lane] > 0.0
                if reached > 0:
                    for lane in range(LANES):
                        if chosen[0, lane] > 0.0:
                            for row in range(STATES):
                                at_end[row, lane] = state[row, lane]
                            part = step
                            if finds_root:
                                part = to_end(lane, parameters, noise, *work[:2], at_end, sensed, excess)
                            if ended_by[first + lane] == NOTHING:
                                ended_by[first + lane] = np.int8(excess[1, lane])
                            end_time[0, lane], end_index[0, lane] = time + part, half_index + 2
                            end_cycle[0, lane] = cycle + (substep + 1 == cycle_steps[cycle])
                            length[first + lane] = flown // every + 1
                            flying[0, lane] = 0.0
                            remaining -= 1
            flown, substep = flown + 1, substep + 1
            if substep == cycle_steps[cycle]:
                cycle, substep = cycle + 1, 0

        finish(end_time, state, found, sensed, nav, command, memory, vehicle, drawn, watched, p, final)
        for row in range(FINAL):
            for lane in range(LANES):
                stored_final[row, first + lane] = final[row, lane]
        for row in range(WATCHED):
            for lane in range(LANES):
                stored_watched[row, first + lane] = watched[row, lane]

    return fly_group
