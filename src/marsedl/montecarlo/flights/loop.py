"""The compiled flight of a group of trials: loops over lanes, the root of the end, noise, air and what is stored."""

import numpy as np

from marsedl.montecarlo.flights.binding import compiled
from marsedl.montecarlo.flights.columns import borrowed, column, dresser, getter, putter
from marsedl.montecarlo.lanes import LANES, called_njit, inline_called_njit, lane_array
from marsedl.montecarlo.streams import NORMALS_PER_BLOCK, fill_normals

END_ITERATIONS = 60  # more than the few that a smooth flight needs


def fly_groups(p, law, pace, draws, sizes, groups, start, vehicle, memory, given_air, results):
    """Fly whole groups; this function is compiled and cached under the name of what is bound to it."""
    seed, first_trial, increments, first_increment, noise_stream, air_stream = draws
    nodes, remembered = sizes
    air, past = np.empty((nodes, LANES)), np.empty((remembered, LANES))
    for number in range(groups[0], groups[1]):
        here = (seed, first_trial + number * LANES, increments, first_increment, noise_stream, air_stream)
        _fly_group(p, law, pace, here, number * LANES, start, vehicle, memory, given_air, results, air, past)  # noqa: F821


def group_flight(model, key, p_shape, law_shape, vehicle_class):
    """Compile (lazily) the flight of LANES trials of a `Flight`, its parameters, law and vehicle being of these shapes.

    Loops over lanes call one function of the model each, so that they become vector code; look-ups and `consult` have
    loops of their own. Conditions of the model, such as `ends`, are constants to the compiler.

    key: digest of all that is compiled. What is called carries it in its name: kernels that other processes compiled
    and cached meet in one, where of two symbols of the same name the first serves both.
    """

    def named_njit(function):
        function.__qualname__ += f"_{key}"
        return called_njit(function)

    integrator, noise_class, end_tolerance, watch_steps = model.options
    functions, classes = model.functions, model.classes
    has = {role: function is not None for role, function in functions.items()}
    ends, varies, looks_up, consults = has["ended"], has["vary"], has["look_up"], has["consult"]
    watches, interrupted_by, senses, observes = has["watch"], has["interrupts"], has["sense"], has["observe"]
    call = {role: compiled(function, role) for role, function in functions.items() if function}
    guides = tuple(compiled(function, "guide") for function in model.guides)
    steers, phases = len(guides) > 0, len(guides)
    finds_root = ends and classes["ended"] is float

    @inline_called_njit
    def absent(*unused):
        return ()

    rates, look_up, sense, interrupts, consult, phase, ended, vary, store, observe, watch, finish = (
        call.get(role, absent)
        for role in (
            *("rates", "look_up", "sense", "interrupts", "consult", "phase"),
            *("ended", "vary", "store", "observe", "watch", "finish"),
        )
    )
    kinds = {**model.parts, "vehicle": vehicle_class, "noise": noise_class}
    (
        get_state,
        get_found,
        get_sensed,
        get_advice,
        get_command,
        get_memory,
        get_vehicle,
        get_noise,
        get_drawn,
        get_watched,
    ) = (
        getter(kinds[name])
        for name in (
            *("state", "found", "sensed", "advice", "command", "memory"),
            *("vehicle", "noise", "drawn", "watched"),
        )
    )
    put_rates = putter(kinds["state"], functions["rates"])
    put_found, put_sensed, put_advice, put_stored, put_observed, put_watched, put_final = (
        putter(kinds[name], functions[role] or absent.py_func)
        for name, role in (
            *(("found", "look_up"), ("sensed", "sense"), ("advice", "consult"), ("stored", "store")),
            *(("observed", "observe"), ("watched", "watch"), ("final", "finish")),
        )
    )
    put_drawn = putter(kinds["drawn"], functions["vary"] or absent.py_func)
    guide_function = model.guides[0] if steers else absent.py_func
    put_command, put_memory = (putter(kinds[name], guide_function) for name in ("command", "memory"))
    STATES, FOUND, SENSED, ADVICE, COMMANDS, MEMORY, VEHICLE, NOISES, DRAWN, WATCHED, STORED, OBSERVED, FINAL = (
        len(kinds[name]._fields)
        for name in (
            *("state", "found", "sensed", "advice", "command", "memory", "vehicle", "noise", "drawn", "watched"),
            *("stored", "observed", "final"),
        )
    )
    dress_p, dress_law = dresser(p_shape), dresser(law_shape)

    @inline_called_njit
    def look_up_all(half_index, time, state, found, air, p):
        if looks_up:
            for lane in range(LANES):
                put_found(look_up(half_index, time, get_state(state, lane), column(air, lane), p), found, lane, None)

    @inline_called_njit
    def drift(half_index, state, noise, parameters, out):
        time, base, step, found, command, vehicle, air, p, known = parameters
        now = time + 0.5 * step * (half_index - base)
        if not known[0]:
            look_up_all(half_index, now, state, found, air, p)
        known[0] = False  # what was looked up at the start of a step serves its first stage
        for lane in range(LANES):
            changes = rates(
                half_index,
                now,
                get_state(state, lane),
                get_found(found, lane),
                get_command(command, lane),
                get_vehicle(vehicle, lane),
                get_noise(noise, lane),
                p,
            )
            put_rates(changes, out, lane, None)

    advance = integrator(drift)

    @named_njit
    def step_lane(part, lane, before, parameters, noise, state, slope, end):
        """Fly a part of a Runge-Kutta step of a single lane, from `before` to `end`."""
        time, base, _, found, command, vehicle, air, p, _ = parameters
        for row in range(STATES):
            slope[row, lane] = 0.0
        for stage in range(4):
            ahead = 0.0 if stage == 0 else (1.0 if stage == 3 else 0.5)
            for row in range(STATES):
                state[row, lane] = before[row, lane] + ahead * part * slope[row, lane]
            now, half_index = time + ahead * part, base + int(2.0 * ahead)
            if looks_up:
                put_found(look_up(half_index, now, get_state(state, lane), column(air, lane), p), found, lane, None)
            changes = rates(
                half_index,
                now,
                get_state(state, lane),
                get_found(found, lane),
                get_command(command, lane),
                get_vehicle(vehicle, lane),
                get_noise(noise, lane),
                p,
            )
            put_rates(changes, slope, lane, None)
            weight = part / 6.0 if stage in (0, 3) else part / 3.0
            for row in range(STATES):
                end[row, lane] = (before[row, lane] if stage == 0 else end[row, lane]) + weight * slope[row, lane]

    @named_njit
    def to_end(lane, before, parameters, noise, state, slope, end):
        """Fly the part of a step after which `ended` is zero; returns it. `end` holds the end of the whole step before.

        Regula falsi between both ends of the step, where an end that is kept twice counts half (Illinois, Dowell and
        Jarratt 1971).
        """
        step, vehicle, p = parameters[2], get_vehicle(parameters[5], lane), parameters[7]
        lower, upper = 0.0, step
        above, below = ended(get_state(before, lane), vehicle, p), ended(get_state(end, lane), vehicle, p)
        part, last_side = upper, 0
        if above <= 0.0:  # it began behind its end
            step_lane(0.0, lane, before, parameters, noise, state, slope, end)
            return 0.0
        for _ in range(END_ITERATIONS):
            part = (lower * below - upper * above) / (below - above)
            step_lane(part, lane, before, parameters, noise, state, slope, end)
            excess = ended(get_state(end, lane), vehicle, p)
            if abs(excess) <= end_tolerance:
                break
            if excess > 0.0:
                below = 0.5 * below if last_side > 0 else below
                lower, above, last_side = part, excess, 1
            else:
                above = 0.5 * above if last_side < 0 else above
                upper, below, last_side = part, excess, -1
        return part

    @named_njit
    def sample_air(seed, stream, first_trial, table, drawn_after, p):
        """The trials' own air, node by node from the last down, one normal a node."""
        bits = np.empty((NORMALS_PER_BLOCK, LANES), np.uint64)
        normal_numbers, drawn, value = lane_array(NORMALS_PER_BLOCK), lane_array(DRAWN), lane_array(1)
        for row in range(DRAWN):
            for lane in range(LANES):
                drawn[row, lane] = 0.0
        top = table.shape[0] - 1
        for number in range(top + 1):
            position, node = number % NORMALS_PER_BLOCK, top - number
            if position == 0:
                fill_normals(seed, stream, first_trial, number // NORMALS_PER_BLOCK, bits, normal_numbers)
            for lane in range(LANES):
                value[0, lane], after = vary(node, normal_numbers[position, lane], get_drawn(drawn, lane), p)
                put_drawn(after, drawn, lane, None)
            for lane in range(LANES):
                table[node, lane] = value[0, lane]
        for row in range(DRAWN):
            for lane in range(LANES):
                drawn_after[row, lane] = drawn[row, lane]

    def steering(number):
        """The compiled guidance of the phases from `number` on; one that no trial needs is not computed."""
        if number == phases:
            return absent
        guide, later = guides[number], steering(number + 1)

        @inline_called_njit
        def steer(place, share, state, found, sensed, advice, memory, vehicle, past, chosen, in_phase, command, law, p):
            half_index, time, cycle = place
            needed = 0
            for lane in range(LANES):
                needed += chosen[0, lane] > 0.0 and in_phase[0, lane] == number
            if phases == 1 or needed > 0:
                for lane in range(LANES):
                    commanded, remembered = guide(
                        half_index,
                        time,
                        cycle,
                        get_state(state, lane),
                        get_found(found, lane),
                        share,
                        get_sensed(sensed, lane),
                        get_advice(advice, lane),
                        get_memory(memory, lane),
                        column(past, lane),
                        get_vehicle(vehicle, lane),
                        law,
                        p,
                    )
                    steered = chosen[0, lane] > 0.0
                    if phases > 1:
                        steered = steered and in_phase[0, lane] == number
                    put_command(commanded, command, lane, steered)
                    put_memory(remembered, memory, lane, steered)
            later(
                *(place, share, state, found, sensed, advice, memory, vehicle, past, chosen, in_phase, command, law, p)
            )

        return steer

    steer = steering(0)

    @named_njit
    def fly_group(
        p_values,
        law_values,
        pace,
        draws,
        first,
        start,
        vehicles,
        memory_at_start,
        given_air,
        results,
        table,
        past_table,
    ):
        p, law, air, past = dress_p(p_values), dress_law(law_values), borrowed(table), borrowed(past_table)
        cycle_start, cycle_step, cycle_steps, every, stores_end = pace
        seed, first_trial, increments, first_increment, noise_stream, air_stream = draws
        history, observed, stored_watched, length, stored_final = results
        rows_stored = min(STORED, history.shape[1])
        drawn = lane_array(DRAWN)
        for row in range(DRAWN):
            for lane in range(LANES):
                drawn[row, lane] = 0.0  # stays, if air is given
        if varies and given_air.shape[0] == 0:
            sample_air(seed, air_stream, first_trial, air, drawn, p)
        for node in range(given_air.shape[0]):
            for lane in range(LANES):
                air[node, lane] = given_air[node, first + lane]
        state, before, at_end = lane_array(STATES), lane_array(STATES), lane_array(STATES)
        work = (lane_array(STATES), lane_array(STATES), lane_array(STATES))
        found, sensed, advice = lane_array(FOUND), lane_array(SENSED), lane_array(ADVICE)
        command, memory, vehicle, noise = (
            lane_array(COMMANDS),
            lane_array(MEMORY),
            lane_array(VEHICLE),
            lane_array(NOISES),
        )
        watched, final, stored, seen = lane_array(WATCHED), lane_array(FINAL), lane_array(STORED), lane_array(OBSERVED)
        flying, chosen, guided, in_phase = lane_array(1), lane_array(1), lane_array(1), lane_array(1)
        end_time, excess, known = lane_array(1), lane_array(1), np.zeros(1, np.bool_)
        bits = np.empty((NORMALS_PER_BLOCK, LANES), np.uint64)
        block_of_normals, filled_block, number = lane_array(NORMALS_PER_BLOCK), -1, first_increment * NOISES
        for lane in range(LANES):
            for row in range(STATES):
                state[row, lane] = start[row, first + lane]
            for row in range(VEHICLE):
                vehicle[row, lane] = vehicles[row, first + lane]
            for row in range(WATCHED):
                watched[row, lane] = stored_watched[row, first + lane]
            for row in range(MEMORY):
                memory[row, lane] = memory_at_start[row]
            for row in range(COMMANDS):
                command[row, lane] = 0.0
            flying[0, lane], guided[0, lane], end_time[0, lane], in_phase[0, lane] = 1.0, 0.0, 0.0, 0.0

        # Not literals: what is called with them would be compiled for the literal, and once more for any integer.
        cycle, substep, flown, remaining = np.int64(0), np.int64(0), np.int64(0), np.int64(LANES)
        while True:
            over = remaining == 0 or cycle == len(cycle_step)
            step = cycle_step[min(cycle, len(cycle_step) - 1)]
            time = cycle_start[cycle] + substep * step
            place = (2 * flown, time, cycle)
            if over and ends:
                for row in range(STATES):
                    for lane in range(LANES):
                        state[row, lane] = state[row, lane] if flying[0, lane] > 0.0 else at_end[row, lane]
            stores, steered = flown % every == 0 and not over, 0
            if steers and not over:
                if substep == 0:
                    steered = LANES
                    for lane in range(LANES):
                        chosen[0, lane] = flying[0, lane]
                elif interrupted_by:
                    for lane in range(LANES):
                        now = interrupts(
                            time,
                            get_state(state, lane),
                            get_memory(memory, lane),
                            get_vehicle(vehicle, lane),
                            law,
                            p,
                        )
                        chosen[0, lane] = flying[0, lane] if now else 0.0
                        steered += chosen[0, lane] > 0.0
            if stores or steered > 0 or over or watch_steps:
                look_up_all(2 * flown, time, state, found, air, p)
                known[0] = True
                if senses:
                    for lane in range(LANES):
                        felt = sense(
                            2 * flown,
                            time,
                            get_state(state, lane),
                            get_found(found, lane),
                            get_command(command, lane),
                            get_vehicle(vehicle, lane),
                            p,
                        )
                        put_sensed(felt, sensed, lane, None)
            if steered > 0:
                if consults:
                    for lane in range(LANES):
                        told = consult(
                            cycle,
                            time,
                            get_sensed(sensed, lane),
                            get_memory(memory, lane),
                            get_vehicle(vehicle, lane),
                            law,
                            p,
                        )
                        put_advice(told, advice, lane, None)
                if phases > 1:
                    for lane in range(LANES):
                        in_phase[0, lane] = phase(
                            cycle,
                            time,
                            get_sensed(sensed, lane),
                            get_memory(memory, lane),
                            get_vehicle(vehicle, lane),
                            law,
                            p,
                        )
                share = substep / cycle_steps[cycle]
                steer(
                    *(place, share, state, found, sensed, advice, memory, vehicle, past),
                    *(chosen, in_phase, command, law, p),
                )
                for lane in range(LANES):
                    guided[0, lane] = 1.0 if chosen[0, lane] > 0.0 else guided[0, lane]
            if watches and (watch_steps or steered > 0):
                for lane in range(LANES):
                    seen_by_now = watch(
                        get_watched(watched, lane),
                        1.0 if over else 0.0,
                        2 * flown,
                        time,
                        cycle,
                        get_state(state, lane),
                        get_found(found, lane),
                        guided[0, lane],
                        get_sensed(sensed, lane),
                        get_command(command, lane),
                        get_memory(memory, lane),
                        get_vehicle(vehicle, lane),
                        p,
                    )
                    put_watched(seen_by_now, watched, lane, (flying if watch_steps else chosen)[0, lane] > 0.0)
            if stores or (over and stores_end):
                stored_row = history.shape[0] - 1 if over else flown // every
                for lane in range(LANES):
                    scene = (
                        2 * flown,
                        time,
                        cycle,
                        get_state(state, lane),
                        get_found(found, lane),
                        guided[0, lane],
                        get_sensed(sensed, lane),
                        get_command(command, lane),
                        get_memory(memory, lane),
                        get_vehicle(vehicle, lane),
                        p,
                    )
                    put_stored(store(*scene), stored, lane, None)
                    if observes:
                        put_observed(observe(*scene), seen, lane, None)
                # Row by row: what is written to many rows at once waits for memory.
                for row in range(rows_stored):
                    for lane in range(LANES):
                        history[stored_row, row, first + lane] = stored[row, lane]
                for row in range(OBSERVED):
                    for lane in range(LANES):
                        observed[stored_row, row, first + lane] = seen[row, lane]
                for lane in range(LANES):
                    guided[0, lane] = 0.0
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
                            fill_normals(seed, noise_stream, first_trial, block, bits, block_of_normals)
                            filled_block = block
                        position = number % NORMALS_PER_BLOCK
                        for lane in range(LANES):
                            noise[component, lane] += block_of_normals[position, lane]
                        number += 1
                for component in range(NOISES):
                    for lane in range(LANES):
                        noise[component, lane] *= scale

            parameters = (time, 2 * flown, step, found, command, vehicle, air, p, known)
            if ends:
                for row in range(STATES):
                    for lane in range(LANES):
                        before[row, lane] = state[row, lane]
            advance(flown, step, state, noise, parameters, work)
            known[0] = False
            if ends:
                reached = 0
                for lane in range(LANES):
                    value = ended(get_state(state, lane), get_vehicle(vehicle, lane), p)
                    if finds_root:
                        excess[0, lane] = 1.0 if value <= 0.0 else 0.0
                    else:
                        excess[0, lane] = 1.0 if value else 0.0
                    excess[0, lane] = excess[0, lane] if flying[0, lane] > 0.0 else 0.0
                    reached += excess[0, lane] > 0.0
                if reached > 0:
                    for lane in range(LANES):
                        if excess[0, lane] > 0.0:
                            for row in range(STATES):
                                at_end[row, lane] = state[row, lane]
                            part = step
                            if finds_root:
                                part = to_end(lane, before, parameters, noise, work[0], work[1], at_end)
                            end_time[0, lane] = time + part
                            length[first + lane] = flown // every + 1
                            flying[0, lane] = 0.0
                            remaining -= 1
            flown, substep = flown + 1, substep + 1
            if substep == cycle_steps[cycle]:
                cycle, substep = cycle + 1, 0

        for lane in range(LANES):
            own = end_time[0, lane] if flying[0, lane] == 0.0 else time
            result = finish(
                own,
                get_state(state, lane),
                get_found(found, lane),
                get_sensed(sensed, lane),
                get_command(command, lane),
                get_memory(memory, lane),
                get_vehicle(vehicle, lane),
                get_drawn(drawn, lane),
                get_watched(watched, lane),
                p,
            )
            put_final(result, final, lane, None)
        for row in range(FINAL):
            for lane in range(LANES):
                stored_final[row, first + lane] = final[row, lane]
        for row in range(WATCHED):
            for lane in range(LANES):
                stored_watched[row, first + lane] = watched[row, lane]

    return fly_group
